"""Every equation of the chain made wrong by one per cent: which golden figure moves.

    python -m tests.faults.equation_faults [--only TEXT]... [--seconds N] [--runs DIR]

Takes the results under `runs/` (`auvid run NAME` before) or in another folder. Each
fault strikes in a process of its own: the function's code is replaced there, the stages
from the first that uses it run again, and their figures are compared with the golden
ones. Prints a row per fault: stage and figure that moved first, or that nothing did.
"""

from __future__ import annotations

import argparse
import ast
import importlib
import inspect
import io
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any

from auvid.data_schemas.units import convertible
from auvid.pipeline.commands.open_run import open_run
from auvid.pipeline.commands.regress import golden_figures as figures
from auvid.pipeline.execution.engines import Serial
from tests.support.campaign_runs import ROOT, copy_workspace, write_workspace

WRONG = 1.01
DIVE, CIRCLE, THAUS, TWIN, VT690, REDESIGN = (
    "bluerov2_dvl",
    "hauv_circle",
    "thaus_twin",
    "vt690_twin",
    "vt690_control",
    "hauv_redesign",
)
UNMOVED = "nothing moved"


@dataclass(frozen=True)
class EquationFault:
    """A function whose result is 1 % too large, or in which `old` reads `new`."""

    name: str
    target: str
    campaign: str
    first: str
    old: str = ""
    new: str = ""


MECHANICS = "hydro.dynamics.mechanics"
ACTUATORS = "hydro.dynamics.actuators"
SIGNALS = "hydro.identification.signals"
BENCH = "hydro.identification.bench"
VISCOUS = "hydro.dynamics.viscous.basis"
ARM = f"{SIGNALS}.bias:lever_arm_velocity"
CORIOLIS = f"{MECHANICS}.rigid_body:coriolis_components"
FORCES = "hydro.dynamics.equations_of_motion:residual_force"
FAULTS = (
    EquationFault(
        "Munk moment left out",
        FORCES,
        DIVE,
        "residual",
        '"added_mass_coriolis": -coriolis_force(vehicle.added_mass, nu)',
        '"added_mass_coriolis": -coriolis_force(vehicle.added_mass, nu) * [1, 1, 1, 0, 0, 0]',
    ),
    EquationFault("Coriolis force", CORIOLIS, DIVE, "residual"),
    EquationFault(
        "Coriolis force of the added mass",
        FORCES,
        DIVE,
        "residual",
        "-coriolis_force(vehicle.added_mass",
        "-1.01 * coriolis_force(vehicle.added_mass",
    ),
    EquationFault(
        "inertia of the added mass",
        FORCES,
        DIVE,
        "residual",
        "-inertia_force(vehicle.added_mass",
        "-1.01 * inertia_force(vehicle.added_mass",
    ),
    EquationFault(
        "restoring force", f"{MECHANICS}.restoring:restoring_components", DIVE, "residual"
    ),
    EquationFault("rigid-body inertia", f"{MECHANICS}.rigid_body:rigid_body_matrix", DIVE, "fuse"),
    EquationFault(
        "rotation to NED", f"{MECHANICS}.kinematics:rotation_entries", CIRCLE, "resample"
    ),
    EquationFault("Euler rates", f"{MECHANICS}.kinematics:euler_rate_entries", CIRCLE, "resample"),
    EquationFault("thrust curve", f"{ACTUATORS}.thrusters:thrust_from_pwm", DIVE, "residual"),
    EquationFault(
        "thruster allocation", f"{ACTUATORS}.thrusters:thruster_allocation", DIVE, "residual"
    ),
    EquationFault("thruster forces", f"{ACTUATORS}.thrusters:thruster_force", DIVE, "residual"),
    EquationFault("fin forces", f"{ACTUATORS}.fins:fin_terms", CIRCLE, "residual"),
    EquationFault("fin coefficients", f"{ACTUATORS}.fins:Fins.coefficients", CIRCLE, "residual"),
    EquationFault("propeller terms", f"{ACTUATORS}.propeller:propeller_terms", CIRCLE, "residual"),
    EquationFault(
        "inflow of the propeller",
        f"{ACTUATORS}.propeller:Propeller.inflow_per_u",
        VT690,  # the thrust of the H-AUV's propeller does not depend on its inflow
        "control",
    ),
    EquationFault(
        "spline: body rates of the attitude",
        f"{SIGNALS}.resampling:smooth_attitude",
        DIVE,
        "resample",
        "omega = 2.0 *",
        "omega = 2.02 *",
    ),
    EquationFault(
        "spline: smoothing chosen",
        f"{SIGNALS}.splines:smoothing_spline",
        DIVE,
        "resample",
        "system.fit(columns[:, same], value)",
        "system.fit(columns[:, same], 1.01 * value)",
    ),
    EquationFault(
        "spline: curvature",
        f"{SIGNALS}.splines:smoothing_spline",
        DIVE,
        "resample",
        "curvature.reshape(values.shape))",
        "1.01 * curvature.reshape(values.shape))",
    ),
    EquationFault("spline: derivative", f"{SIGNALS}.splines:derivative", DIVE, "fuse"),
    EquationFault("low-pass", f"{SIGNALS}.filters:zero_phase_lowpass", DIVE, "fuse"),
    EquationFault("low-pass: edge", f"{SIGNALS}.filters:edge_zone_s", DIVE, "fuse"),
    EquationFault("gyro bias: integral", f"{SIGNALS}.bias:integrate", DIVE, "fuse"),
    EquationFault("arm of the velocity log", ARM, DIVE, "resample"),
    EquationFault("smoother: process", f"{SIGNALS}.smoother:process_model", CIRCLE, "fuse"),
    EquationFault("smoother: measurements", f"{SIGNALS}.smoother:_measurements", CIRCLE, "fuse"),
    EquationFault("cross-flow speed", f"{VISCOUS}:cross_flow_speed", TWIN, "synthesise"),
    EquationFault("propulsion ratio", f"{VISCOUS}:eta_ratio", CIRCLE, "residual"),
    EquationFault(
        "batch least squares",
        f"{BENCH}.recursive_least_squares:batch_least_squares",
        THAUS,
        "pipendulum",
    ),
    EquationFault(
        "quadrifilar pendulum", f"{BENCH}.quadrifilar:equivalent_inertia", THAUS, "pipendulum"
    ),
    EquationFault(
        "drop of the pendulum", f"{BENCH}.quadrifilar:QuadrifilarGeometry.drop", THAUS, "pipendulum"
    ),
    EquationFault("hollow cylinder", f"{BENCH}.quadrifilar:hollow_cylinder", THAUS, "pipendulum"),
    EquationFault("regulator gain", "hydro.control.riccati:regulator_gain", REDESIGN, "control"),
    EquationFault("observer gain", "hydro.control.observer:kalman_gain", REDESIGN, "control"),
)


def larger(value: ast.expr) -> ast.expr:
    """Return an expression 1 % larger, each entry of tuples of tuples by itself."""
    if isinstance(value, ast.Tuple):
        return ast.Tuple([larger(part) for part in value.elts], ast.Load())
    return ast.BinOp(ast.Constant(WRONG), ast.Mult(), value)


class Scaled(ast.NodeTransformer):
    """Makes what a function returns 1 % too large; its inner functions stay."""

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
        return node

    def visit_Return(self, node: ast.Return) -> ast.AST:
        assert node.value is not None
        node.value = larger(node.value)
        return node


def function_of(target: str) -> FunctionType:
    """Return the function that `module:qualified.name` names, also behind a property."""
    module, _, name = target.partition(":")
    member: Any = importlib.import_module(f"auvid.{module}")
    for part in name.split("."):
        member = inspect.getattr_static(member, part)
    if isinstance(member, property):
        member = member.fget
    elif isinstance(member, cached_property):
        member = member.func
    assert isinstance(member, FunctionType), target
    return member


def wrong_code(function: FunctionType, old: str, new: str) -> CodeType:
    """Return the code of a function with `old` replaced, or its result scaled."""
    path = inspect.getsourcefile(function)
    assert path is not None
    lines, first = inspect.getsourcelines(function)
    source = Path(path).read_text(encoding="utf-8")
    body = "".join(lines)
    if old:
        assert body.count(old) == 1, f"{function.__qualname__}: {old!r} is not there once"
        source = source.replace(body, body.replace(old, new))
    tree = ast.parse(source)
    node = next(
        node
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef)
        and node.name == function.__name__
        and first <= node.lineno < first + len(lines)
    )
    if not old:
        node.body = [Scaled().visit(line) for line in node.body]
        ast.fix_missing_locations(tree)
    return next(
        code
        for code in codes(compile(tree, path, "exec"))
        if code.co_qualname == function.__qualname__
    )


def codes(code: CodeType) -> Iterator[CodeType]:
    """Yield a code object and all within it."""
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from codes(constant)


def strike(fault: EquationFault, workspace: Path) -> str:
    """Return which golden figure of a workspace's campaign moves first under a fault."""
    function = function_of(fault.target)
    function.__code__ = wrong_code(function, fault.old, fault.new)
    os.chdir(workspace)
    run = open_run(fault.campaign)
    folder = ROOT / "tests" / "golden" / fault.campaign
    golden = figures.read_figures(folder)
    names = [stage.name for stage in figures.stages_of(run)]
    for stage in figures.stages_of(run)[names.index(fault.first) :]:
        if not run.manifests[stage.name].records:
            break
        try:
            run.execute([stage], Serial(), force=True)
        except Exception as refusal:
            return f"stage {stage.name} refuses: {str(refusal).splitlines()[0][:60]}"
        new = figures.figures_of(run, [stage], without=figures.left_out(folder))
        old = {
            file: {key: figure for key, figure in rows.items() if key[0] == stage.name}
            for file, rows in golden.items()
        }
        if file_moved := figures.compare(old, new)[1]:
            return figures.first_change(file_moved)
    return UNMOVED


def outcome(fault: EquationFault, workspace: Path) -> str:
    """Return `strike` of a copy of the workspace, in a process of its own."""
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reader)
        with tempfile.TemporaryDirectory(prefix="auvid_equation_") as folder:
            sys.stdout = sys.stderr = io.StringIO()
            try:
                words = strike(fault, copy_workspace(workspace, Path(folder) / "copy"))
            except BaseException as crash:
                words = f"internal: {crash!r}"
            os.chdir("/")
        os.write(writer, words.encode()[:4000])
        os._exit(0)
    os.close(writer)
    with os.fdopen(reader, "rb") as pipe:
        words = pipe.read().decode()
    os.waitpid(child, 0)
    return words


def load_what_all_need() -> None:
    """Load, once for all processes, what takes each of them seconds.

    Only what no equation goes into.
    """
    importlib.import_module("scipy.signal")
    assert convertible("kg", "g")


def main() -> int:
    """Print what moves under each fault; 1 where nothing does."""
    options = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    options.add_argument("--only", action="append", help="faults of this name or campaign")
    options.add_argument("--runs", type=Path, default=ROOT / "runs", help="folder of results")
    options.add_argument("--seconds", type=float, default=float("inf"), help="stop after these")
    chosen = options.parse_args()
    end, unmoved = time.monotonic() + chosen.seconds, 0
    load_what_all_need()
    with tempfile.TemporaryDirectory(prefix="auvid_equations_") as folder:
        for fault in FAULTS:
            workspace = Path(folder) / fault.campaign
            if chosen.only and not {fault.name, fault.campaign} & set(chosen.only):
                continue
            if time.monotonic() > end:
                break
            if not workspace.exists():
                write_workspace(workspace, fault.campaign)
                (workspace / "vehicles").symlink_to(ROOT / "vehicles")
                results = chosen.runs / fault.campaign
                shutil.copytree(results, workspace / "runs" / fault.campaign)
            words = outcome(fault, workspace)
            unmoved += words == UNMOVED or words.startswith("internal")
            print(f"{fault.name} | {fault.campaign} | {words}", flush=True)
    return int(unmoved > 0)


if __name__ == "__main__":
    sys.exit(main())
