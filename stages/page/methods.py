"""The methods of a run as a text for a paper, with references and versions."""

from __future__ import annotations

import platform
from collections.abc import Mapping, Sequence
from typing import Any

from auvid.data_schemas.documents.model import assumed_quantities
from auvid.data_schemas.records.models import ModelCard
from auvid.data_schemas.records.motion import SegmentRecord
from auvid.data_schemas.records.partial import PartialFigures
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.stages.base import Document
from auvid.stages.number_format import fit_in_percent
from auvid.stages.page.first_screen import ALL, AXIS_WORDS, Summary
from auvid.stages.presentation import paste, section

ORDER = 999
REFERENCES = {
    "McCarter 2014": (
        "McCarter, B. R. Experimental Evaluation of Viscous Hydrodynamic Force Models for"
        " Autonomous Underwater Vehicles. MSc thesis, Virginia Tech, 2014."
    ),
    "Craven and Wahba 1979": (
        "Craven, P., and Wahba, G. Smoothing noisy data with spline functions. Numerische"
        " Mathematik 31 (1979), 377-403."
    ),
    "Rauch et al. 1965": (
        "Rauch, H. E., Tung, F., and Striebel, C. T. Maximum likelihood estimates of linear"
        " dynamic systems. AIAA Journal 3 (1965), 1445-1450."
    ),
    "MacKinnon and White 1985": (
        "MacKinnon, J. G., and White, H. Some heteroskedasticity-consistent covariance matrix"
        " estimators with improved finite sample properties. Journal of Econometrics 29 (1985),"
        " 305-325."
    ),
    "Bell and McCaffrey 2002": (
        "Bell, R. M., and McCaffrey, D. F. Bias reduction in standard errors for linear regression"
        " with multi-stage samples. Survey Methodology 28 (2002), 169-181."
    ),
    "Schwarz 1978": (
        "Schwarz, G. Estimating the dimension of a model. Annals of Statistics 6 (1978), 461-464."
    ),
}
"""Key in the text -> entry of the list of references."""
SMOOTHING = {
    "gcv": "by smoothing splines chosen by generalised cross-validation (Craven and Wahba 1979)",
    "cutoff": "by smoothing splines with a half-amplitude frequency of {cutoff_hz:g} Hz",
    "none": "by interpolating splines",
}
"""Parameter `smoothing` of resample -> words; its other parameters fill them in."""
FUSION = {
    "kinematic": "taken from the velocity log, with its arm, the attitude and the gyro",
    "thesis": "integrated from the accelerometer with a constant bias (McCarter 2014, chapter 2)",
    "smoother": "estimated by a Rauch-Tung-Striebel smoother of all sensors (Rauch et al. 1965)",
}
"""Parameter `method` of fuse -> words."""
ESTIMATION = {
    "least squares": "by least squares",
    "within limits": "by least squares within physical limits",
    "error function": "by another error function than squares of equal weight",
    "output error": "by the output error method (maximum likelihood of the sensors)",
    "filter error": "by the filter error method (maximum likelihood of the sensors)",
    "axes": "by output error over windows of single axes",
    "glides": "by the balance of steady glides (Merckelbach et al. 2010)",
    "passive motion": "by tows, coasts and free decays",
}
"""Method of a model card -> words."""
COLOURED = ("least squares", "within limits")
"""Methods whose intervals come from leaving blocks of time out."""


def methods_section(
    provenance: Document,
    vehicle: Vehicle,
    segments: Mapping[str, SegmentRecord],
    cards: Mapping[str, ModelCard],
    summary: Summary,
) -> dict[str, Any]:
    """Return the section: what was done in sentences, references, versions."""
    parameters = {name: entry["parameters"] for name, entry in provenance["stages"].items()}
    sentences = [*_data(vehicle, segments, twin="simulate" in parameters), *_signals(parameters)]
    sentences += _models(cards, summary)
    words = " ".join(sentences)
    named = [entry for key, entry in REFERENCES.items() if key in words]
    versions = {"Python": platform.python_version(), **provenance["packages"]}
    software = ", ".join(f"{name} {number}" for name, number in versions.items() if name != "auvid")
    version = provenance["packages"].get("auvid", "")
    software = f"All results were computed with auvid {version}".rstrip() + f" ({software});"
    software += f" stages in order: {', '.join(parameters)}."
    paragraphs = [words, software, *named]
    return section(
        "Methods text",
        [paste("\n".join(filter(None, paragraphs)))],
        order=ORDER,
        look_for="To paste into a paper: what this run did, with references and versions.",
    )


def _data(vehicle: Vehicle, segments: Mapping[str, SegmentRecord], *, twin: bool) -> list[str]:
    """Return what was used; the logs of a `twin` are simulated."""
    assumed = len(list(assumed_quantities(vehicle.document)))
    first = f"The vehicle is {vehicle.title}."
    if assumed:
        first += f" Of its mass, inertia, added mass, thrust and sensors {assumed} values are"
        first += " assumed, not measured."
    words = []
    for use in ("training", "validation"):
        of_use = [item for item in segments.values() if item.use == use]
        if of_use:
            seconds = sum(item.duration_s for item in of_use)
            legs = len({item.leg for item in of_use})
            words.append(f"{seconds:.0f} s in {legs} leg{'s' * (legs > 1)} for {use}")
    logs = len({item.log for item in segments.values()})
    return [first] + (
        [f"From {logs} {'simulated ' * twin}log{'s' * (logs > 1)} we used {' and '.join(words)}."]
        if words
        else []
    )


def _signals(parameters: Mapping[str, Mapping[str, Any]]) -> list[str]:
    sentences = []
    if resample := parameters.get("resample"):
        words = SMOOTHING[resample["smoothing"]].format(**resample)
        sentences.append(f"All sensors were brought to {resample['rate_hz']:g} Hz {words}.")
    if fuse := parameters.get("fuse"):
        words = f"Velocity and acceleration of the body were {FUSION[fuse['method']]}"
        if fuse.get("cutoff_hz"):
            words += (
                f", and all channels passed one zero-phase low-pass of {fuse['cutoff_hz']:g} Hz"
            )
        sentences.append(f"{words}.")
    if "residual" in parameters:
        sentences.append(
            "The residual force is what rigid body, added mass, restoring force and actuators"
            " leave unexplained (McCarter 2014, equation 4.4)."
        )
    return sentences


def _models(cards: Mapping[str, ModelCard], summary: Summary) -> list[str]:
    if not cards:
        return []
    sentences = []
    for method, words in ESTIMATION.items():
        fitted = [card for card in cards.values() if card.method == method]
        if fitted:
            models = f"{len(fitted)} model{'s' * (len(fitted) > 1)}"
            sentences.append(f"We fitted {models} {words}: {_listed(fitted)}.")
        if fitted and method in COLOURED:
            spread = any(card.spreads for card in fitted)
            sentences.append(
                "Their 95 % intervals allow for coloured residuals, by leaving blocks of time out"
                " in turn (MacKinnon and White 1985)"
                + " and for the spread of assumed values of the vehicle" * spread
                + "."
            )
    for card in cards.values():
        sentences += [] if card.partial is None else _parts(card.partial)
    chosen = next((item for item in summary.models if item.name == summary.recommended), None)
    if chosen is not None:
        merit = chosen.axes[ALL]
        words = (
            f"{chosen.title} was chosen as {summary.rule.removeprefix('Chosen as ').rstrip('.')}"
        )
        words += " (BIC: Schwarz 1978)" if "BIC" in summary.rule else ""
        if merit.validation is not None and summary.judged_on == "validation":
            words += f"; on the validation legs its error is {merit.validation:.2f} of the force"
            words += " (J/J0, root mean squares; McCarter 2014, equations 4.22 to 4.27)"
        if chosen.runs:
            words += f", and {chosen.runs - chosen.lost} of {chosen.runs} free runs stayed bounded"
        sentences.append(f"{words}.")
        sentences += _limits_and_priors(next(c for c in cards.values() if c.name == chosen.name))
    return sentences


def _parts(part: PartialFigures) -> list[str]:
    """Return which axes a partial model has, how they were judged, and its newtons."""
    judged = [
        f"{AXIS_WORDS[axis]} {fit_in_percent(item.held_out_percent)}"
        for axis, item in part.axes.items()
        if item.held_out_percent is not None
    ]
    sentences = []
    if judged:
        sentences.append(
            "On windows that were held out the fit of the rate, 100 (1 - |error| / |departure from"
            f" the mean|), is {', '.join(judged)}; intervals come from windows left out in turn"
            " (Bell and McCaffrey 2002)."
        )
    sentences += [
        f"Damping in {AXIS_WORDS[axis]} is not from these logs but from {item.name}."
        for axis, item in part.axes.items()
        if item.source != "fitted"
    ]
    if part.unit_of_mass is not None:
        sentences.append(
            "No force in newtons is known: all counts in the apparent inertia of"
            f" {AXIS_WORDS[part.unit_of_mass]}, with the ratios of inertia of the vehicle file."
        )
    if part.scale is not None:
        sentences.append(
            f"Newtons follow from a {part.scale.source} in {AXIS_WORDS[part.scale.axis]}."
        )
    return sentences


def _limits_and_priors(card: ModelCard) -> list[str]:
    """Return what holds the coefficients of the chosen model beside its data."""
    sentences = []
    if card.damping != "free":
        sentences.append(f"Its damping was held within physical limits ({card.damping}).")
    if card.prior is not None:
        names = [f"{axis}_{term}" for axis, terms in card.prior.means.items() for term in terms]
        source = {"strip_theory": "strip theory", "vehicle": "published coefficients"}
        sentences.append(
            f"{', '.join(names)} had a prior from {source[card.prior.source]} with a standard"
            f" deviation of {100.0 * card.prior.relative_sd:g} % of each value."
        )
    for prior in card.measured_priors:
        if prior.source == "shelf":
            sentences.append(f"A prior came from the published set {prior.file}.")
        else:
            sentences.append(f"A prior with its covariance came from {prior.file}.")
    return sentences


def _listed(cards: Sequence[ModelCard]) -> str:
    return ", ".join(f"{card.title} ({card.n_bar} terms)" for card in cards)
