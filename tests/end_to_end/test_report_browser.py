"""The report in a real browser: it draws, sorts, zooms, prints, and says nothing on the
console. Pictures go to build/screenshots.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Iterator
from importlib import resources
from pathlib import Path

import numpy as np
import pytest

from auvid.stages.page.html import render
from auvid.stages.presentation import panel, plot, remark, section, series, table
from auvid.stages.report import Params, run
from auvid.stages.report.summary.figure_summary import summarise_results
from tests.support.browser import Browser, chromium
from tests.support.campaign_runs import copy_workspace, run_campaign
from tests.support.example_run import example_run

PICTURES = Path(__file__).parents[2] / "build" / "screenshots"
PROGRAM = chromium()
DEMO = "bluerov2_dvl"
PAPER_PX = (688, 990)
"""Width and height of a sheet of A4 between its margins, in pixels of 1/96 inch."""
FIRST_FRAME = "document.querySelector('.frame')"
FIRST_AREA = "document.querySelector('.area')"
BOX = "(({left, top, width, height}) => [left, top, width, height])"

WIDEST = [
    "2023-07-14_09-02-35.tlog",
    "bluerov2_heavy",
    "symmetric_quadratic",
    0.221,
    *["simulation"] * 3,
    "from the prior",
    "from the prior",
    "not excited",
    "2014-07-01 10:00",
    "2023_07_14_09_02_35-455fd349",
]
"""The longest words of each column of a thousand dives."""

pytestmark = pytest.mark.skipif(PROGRAM is None, reason="needs Chromium: apt-get install chromium")


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("report") / "report.html"
    file.write_bytes(
        run(example_run({"train": 20.0, "check": 10.0}).inputs(), Params()).report_html
    )
    return file


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    assert PROGRAM is not None
    with Browser(PROGRAM) as window:
        yield window


@pytest.fixture
def page(browser: Browser, report: Path) -> Iterator[Browser]:
    """The report opened at 1280 px with all folds open; nothing may have been said on the console
    by the end of the test.
    """
    browser.messages.clear()
    browser.open(report)
    browser.evaluate("document.getElementById('unfold').click()")
    yield browser
    assert browser.messages == []


def area(page: Browser) -> tuple[float, float, float, float]:
    """Place of the first plot, scrolled into view; sections get their height when they
    come near, so until it stays where it is.
    """
    last: tuple[float, float, float, float] | None = None
    for _ in range(20):
        page.evaluate(f"{FIRST_AREA}.scrollIntoView({{block: 'center'}})")
        page.screenshot()  # lays the page out
        left, top, width, height = page.evaluate(f"{BOX}({FIRST_AREA}.getBoundingClientRect())")
        if last == (left, top, width, height):
            return last
        last = (left, top, width, height)
    raise AssertionError(f"the first plot does not come to rest: {last}")


def view(page: Browser) -> list[float]:
    """The x-range in view of the first plot, in seconds."""
    return [float(value) for value in page.evaluate("plots[0].view")]


@pytest.mark.parametrize(
    ("width", "height", "dark"), [(1280, 1000, False), (1280, 1000, True), (390, 1200, False)]
)
def test_page_fits_its_window_and_is_not_empty(
    browser: Browser, report: Path, width: int, height: int, dark: bool
) -> None:
    browser.messages.clear()
    browser.open(report, width=width, height=height, dark=dark)
    PICTURES.mkdir(parents=True, exist_ok=True)
    picture = browser.screenshot(PICTURES / f"report_{width}{'_dark' if dark else ''}.png")
    assert len(picture) > 20_000, "an empty page of this size compresses to less"
    assert browser.evaluate("document.documentElement.scrollWidth") <= width
    assert browser.messages == []


def test_first_screen_says_what_was_identified_how_good_what_is_missing_and_which_model(
    browser: Browser, report: Path
) -> None:
    browser.messages.clear()
    browser.open(report, width=1440, height=1000)
    for item, edge in ((".answer", "bottom"), ("#coefficients", "bottom"), ("#alerts", "top")):
        assert (
            browser.evaluate(f"document.querySelector('{item}').getBoundingClientRect().{edge}")
            < 1000
        ), item
    assert browser.evaluate("document.querySelector('.matrix').offsetHeight") > 100
    assert browser.messages == []


OPEN_FOLDS = "document.querySelectorAll('main details[open]').length"
ALL_FOLDS = "document.querySelectorAll('main details').length"


def test_open_all_opens_every_fold_and_row_and_closes_them_again(
    browser: Browser, report: Path
) -> None:
    browser.open(report)
    first, every = browser.evaluate(OPEN_FOLDS), browser.evaluate(ALL_FOLDS)
    assert first < every
    hidden = "[...document.querySelectorAll('tr.rest')].filter(row => !row.offsetHeight).length"
    assert browser.evaluate(hidden) > 0
    browser.evaluate("document.getElementById('unfold').click()")
    assert browser.evaluate(OPEN_FOLDS) == every
    assert browser.evaluate(hidden) == 0
    browser.evaluate("document.getElementById('unfold').click()")
    assert browser.evaluate(OPEN_FOLDS) == first
    assert browser.evaluate(hidden) > 0


def test_print_has_what_is_open(browser: Browser, report: Path) -> None:
    browser.open(report)
    few = len(re.findall(rb"/Type\s*/Page\b", browser.pdf()))
    browser.evaluate("document.getElementById('unfold').click()")
    assert len(re.findall(rb"/Type\s*/Page\b", browser.pdf())) > few


def test_no_plot_is_parted_by_the_end_of_a_printed_page(browser: Browser, report: Path) -> None:
    browser.open(report, width=PAPER_PX[0])
    browser.call("Emulation.setEmulatedMedia", media="print")
    browser.evaluate("document.getElementById('unfold').click()")
    plots = browser.evaluate(
        "[...document.querySelectorAll('figure.plot')].map(plot => [plot.offsetHeight,"
        " plot.querySelectorAll('.panel').length, getComputedStyle(plot).breakInside])"
    )
    assert {rule for _, _, rule in plots} == {"avoid"}
    assert max(height for height, _, _ in plots) < PAPER_PX[1]
    of_six = [height for height, panels, _ in plots if panels == 6]
    assert of_six, "panels of a free run with nine states are as low as those of six"
    assert max(of_six) / 6 * 9 < PAPER_PX[1]


def test_an_alert_leads_to_its_place_through_folds(browser: Browser, report: Path) -> None:
    browser.open(report)
    links = browser.evaluate(
        "[...document.querySelectorAll('.alerts a')].map(link => link.hash.slice(1))"
    )
    assert links
    for link in links:
        browser.evaluate(f"location.hash = {link!r}")
        browser.evaluate("new Promise(done => setTimeout(done, 50))")
        height = browser.evaluate(f"document.getElementById({link!r}).offsetHeight")
        assert height > 0, link


def test_a_table_keeps_back_what_was_not_identified_until_asked(
    browser: Browser, report: Path
) -> None:
    browser.open(report)
    rows = (
        "[...document.querySelectorAll('.coefficients tbody tr')]"
        ".filter(row => row.offsetHeight).length"
    )
    all_rows = browser.evaluate("document.querySelectorAll('.coefficients tbody tr').length")
    assert 0 < browser.evaluate(rows) < all_rows
    browser.evaluate("document.querySelector('#coefficients button.rows').click()")
    assert browser.evaluate(rows) == all_rows


def test_every_table_can_be_saved_as_csv(page: Browser) -> None:
    assert page.evaluate(
        "[...document.querySelectorAll('main table')].every(table =>"
        " table.closest('figure').querySelector('button.csv'))"
    )


EVERY = set(itertools.product((1440, 390), (False, True), (False, True)))
OPPOSITES = {(1440, False, True), (390, True, False)}
"""Cases with every width, colours and folds; the others for a release."""


@pytest.mark.parametrize(
    ("width", "dark", "opened"),
    [
        *sorted(OPPOSITES),
        *(pytest.param(*case, marks=pytest.mark.release) for case in sorted(EVERY - OPPOSITES)),
    ],
)
def test_axe_finds_no_violation(
    browser: Browser, report: Path, width: int, dark: bool, opened: bool
) -> None:
    violations = accessibility_faults(browser, report, width=width, dark=dark, opened=opened)
    assert violations == []


@pytest.fixture(scope="module")
def page_of_figures(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the page of a campaign without models: figures, bounds, plots and remarks."""
    rows = [
        {"quantity": f"rms cross-track, helix, {name}", "value": value, "unit": "m", "low": low}
        | {"high": 2.0 * value, "verdict": verdict, "note": "Helix", "headline": True}
        for name, value, low, verdict in (("side_force", 0.2, 0.1, "held"), ("late", 0.3, 0.2, ""))
    ]
    bound = {"quantity": "2.9, has no printed value: bounds met of 4", "value": 3.0, "unit": "1"}
    bound |= {"verdict": "missed", "evidence": "unprinted", "headline": True}
    results = {
        "control": {"title": "Control", "rows": rows},
        "check_published": {"title": "Printed", "rows": [bound]},
    }
    t_s = np.linspace(0.0, 60.0, 50)
    lines = [series(name, t_s, np.sin(t_s), "estimate") for name in ("side force", "late")]
    blocks = [
        remark("The helix is left.", "warning"),
        remark("All stay.", "finding"),
        table("Errors", ["flight", "error"], [["late", 0.3], ["side force", 0.2]], note="RMS"),
        plot("Distance", [panel("cross-track", "m", lines)]),
        table("Dives", [f"column {number}" for number in range(12)], [WIDEST]),
    ]
    sections = {"control": section("Control", blocks, order=1, look_for="Whether it stays.")}
    summary = summarise_results(results, {}, sections, example_run({"train": 4.0}).vehicle)
    file = tmp_path_factory.mktemp("figures") / "report.html"
    file.write_bytes(render("Helix", "Torpedo", "", summary, sections))
    return file


@pytest.mark.parametrize(("width", "dark", "opened"), [(1440, False, True), (390, True, False)])
def test_axe_finds_no_violation_on_a_page_without_models(
    browser: Browser, page_of_figures: Path, width: int, dark: bool, opened: bool
) -> None:
    assert (
        accessibility_faults(browser, page_of_figures, width=width, dark=dark, opened=opened) == []
    )
    assert browser.evaluate("document.documentElement.scrollWidth") <= width
    if width == 1440:
        runs_over = "[...document.querySelectorAll('.scroll')].filter(at => at.scrollWidth > at"
        assert browser.evaluate(f"{runs_over}.clientWidth).map(at => at.ariaLabel)") == []


def accessibility_faults(
    browser: Browser, report: Path, *, width: int, dark: bool = False, opened: bool = False
) -> list[str]:
    """Return rule and first element of each violation that axe-core finds."""
    pytest.importorskip("axe_core_python")
    axe = (resources.files("axe_core_python") / "axe.min.js").read_text(encoding="utf-8")
    browser.open(report, width=width, dark=dark)
    if opened:
        browser.evaluate("document.getElementById('unfold').click()")
    browser.call("Runtime.evaluate", expression=axe)
    return list(
        browser.evaluate(
            "axe.run(document, {resultTypes: ['violations']}).then(result => result.violations.map("
            "item => `${item.id}: ${item.nodes[0].html.slice(0, 200)}"
            " ${item.nodes[0].failureSummary}`))"
        )
    )


@pytest.fixture(scope="module")
def demo(committed_run: Callable[[str], Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the report of the bundled dive."""
    folder = copy_workspace(committed_run(DEMO), tmp_path_factory.mktemp("demo") / "run")
    run_campaign(folder, DEMO, None)
    return folder / "runs" / DEMO / "report" / "report_html.html"


BOTTOM = "(id => document.querySelector(id).getBoundingClientRect().bottom + scrollY)"
OUTSIDE = """[...document.querySelectorAll('.uses b')].filter(word => {
  const box = word.closest('.uses').getBoundingClientRect(), part = word.getBoundingClientRect();
  return part.top < box.top || part.bottom > box.bottom || part.left < box.left;
}).length"""
"""Words of what the model is for that do not stand in their list."""
WORDS = r"document.body.innerText.split(/\s+/).filter(word => /[\p{L}\p{N}]/u.test(word)).length"
READY_MS = "performance.getEntriesByType('navigation')[0].domInteractive"


@pytest.mark.parametrize(("width", "first_screen_px"), [(1440, 1000), (390, 1600)])
def test_the_answer_of_the_demo_stands_on_the_first_screen(
    browser: Browser, demo: Path, width: int, first_screen_px: int
) -> None:
    browser.open(demo, width=width)
    pictures = browser.evaluate("document.querySelectorAll('.pictures .picture').length")
    assert pictures == 2
    for part in (".answer", ".pictures", "#coefficients"):
        assert browser.evaluate(f"{BOTTOM}({part!r})") <= first_screen_px, part
    if width > 1000:
        worst = "#alerts li:nth-child(3)"
        assert browser.evaluate(f"{BOTTOM}({worst!r})") <= first_screen_px, "the worst alerts"
    assert browser.evaluate(OUTSIDE) == 0
    assert browser.evaluate("document.documentElement.scrollWidth") <= width


def test_the_page_of_the_demo_is_short_and_light(browser: Browser, demo: Path) -> None:
    assert demo.stat().st_size <= 1_500_000
    ready_ms = []
    for _ in range(3):
        browser.open(demo, width=1440)
        ready_ms.append(browser.evaluate(READY_MS))
    assert min(ready_ms) <= 1000, "the fastest of three: other work may slow this machine down"
    assert browser.evaluate("document.documentElement.scrollHeight") <= 8000
    assert browser.evaluate(WORDS) <= 2500


@pytest.mark.parametrize("width", [1440, pytest.param(390, marks=pytest.mark.release)])
def test_axe_finds_no_violation_in_the_demo(browser: Browser, demo: Path, width: int) -> None:
    assert accessibility_faults(browser, demo, width=width) == []


def test_every_plot_draws_its_lines(page: Browser) -> None:
    drawn = page.evaluate(
        """(() => {
        return [...document.querySelectorAll('.area path.line:not(.off)')].map(line => {
          const box = line.getBoundingClientRect();
          const area = line.closest('.area').getBoundingClientRect();
          return [box.width / area.width, box.height / area.height]; }); })()"""
    )
    assert len(drawn) > 80
    assert all(0.4 < width < 1.01 and 0.2 < height < 1.0 for width, height in drawn)


def test_scriptless_page_has_the_same_lines_and_labels(page: Browser, report: Path) -> None:
    page.call("Emulation.setScriptExecutionDisabled", value=True)
    page.open(report)
    picture = page.screenshot()
    page.call("Emulation.setScriptExecutionDisabled", value=False)
    assert len(picture) > 20_000
    assert page.evaluate("document.querySelectorAll('.y span').length") > 30


def test_drag_zooms_all_plots_of_the_leg_and_double_click_resets(page: Browser) -> None:
    left, top, width, height = area(page)
    full = view(page)
    page.drag((left + 0.25 * width, top + height / 2), (left + 0.5 * width, top + height / 2))
    low, high = view(page)
    span = full[1] - full[0]
    assert low == pytest.approx(
        full[0] + 0.25 * span, abs=0.01 * span
    )  # a hundredth of the axis: whole pixels
    assert high == pytest.approx(full[0] + 0.5 * span, abs=0.01 * span)
    same = (
        "plots.filter(p => p.low < {high} && p.high > {low}).every(p => p.view[0] === {low} ||"
        " p.low > {low})"
    )
    assert page.evaluate(same.format(low=low, high=high))
    assert page.evaluate("plots.some(p => p.low >= plots[0].high - 1 && p.view[1] === p.high)"), (
        "the other leg keeps its range"
    )
    page.mouse("mousePressed", left + 0.3 * width, top + height / 2, clickCount=2)
    page.mouse("mouseReleased", left + 0.3 * width, top + height / 2, clickCount=2)
    assert view(page) == full


def test_wheel_zooms_a_focused_plot_only(page: Browser) -> None:
    left, top, width, height = area(page)
    full = view(page)
    centre = (left + width / 2, top + height / 2)
    page.mouse("mouseWheel", *centre, deltaX=0, deltaY=-200)
    assert view(page) == full
    left, top, width, height = area(page)
    page.evaluate(f"{FIRST_FRAME}.focus()")
    page.mouse("mouseWheel", left + width / 2, top + height / 2, deltaX=0, deltaY=-200)
    assert view(page)[1] - view(page)[0] == pytest.approx(0.8 * (full[1] - full[0]))


def test_keyboard_moves_the_cursor_zooms_pans_and_resets(page: Browser) -> None:
    area(page)
    full = view(page)
    page.evaluate(f"{FIRST_FRAME}.focus()")
    page.press("ArrowRight")
    readout = page.evaluate("document.querySelector('.panel output').textContent")
    assert readout.startswith("at ")
    page.press("+")
    zoomed = view(page)
    assert zoomed[1] - zoomed[0] == pytest.approx(0.8 * (full[1] - full[0]))
    page.press("ArrowRight", shift=True)
    assert view(page)[0] > zoomed[0]
    page.press("Escape")
    assert view(page) == full


def test_readout_is_the_value_of_the_line(page: Browser) -> None:
    value, near = page.evaluate(
        """(() => { const line = document.querySelector('path.line');
        const {xs, ys} = decode(line), i = 40;
        return [ys[i], plots[0].nearest(line, xs[i])]; })()"""
    )
    assert value == near


def test_legend_hides_a_line_and_the_axis_follows(page: Browser) -> None:
    page.evaluate("window.chosen = document.querySelector('#validate figure.plot')")
    hidden = page.evaluate("chosen.querySelectorAll('.legend [aria-pressed=false]').length")
    assert hidden == 5, "of eight models three are drawn at first"
    page.evaluate("chosen.querySelector('.all').click()")
    assert page.evaluate("chosen.querySelectorAll('path.line.off').length") == 0
    page.evaluate("chosen.querySelector('.legend [data-entry=\"0\"]').click()")
    assert page.evaluate("chosen.querySelectorAll('path.line.off').length") == 6


def test_table_sorts_by_click_and_by_enter(page: Browser) -> None:
    page.evaluate("window.table = document.querySelector('#validate table.sortable')")
    cells = "[...table.tBodies[0].rows].map(row => Number(sorted(row.cells[1])))"
    page.evaluate("table.tHead.rows[0].cells[1].querySelector('button').click()")
    rising = page.evaluate(cells)
    assert rising == sorted(rising)
    assert page.evaluate("table.tHead.rows[0].cells[1].getAttribute('aria-sort')") == "ascending"
    page.evaluate("table.tHead.rows[0].cells[1].querySelector('button').focus()")
    page.press("Enter")
    assert page.evaluate(cells) == rising[::-1]
    assert page.evaluate("table.tHead.rows[0].cells[1].getAttribute('aria-sort')") == "descending"


def test_empty_cells_sort_last_either_way(page: Browser) -> None:
    page.evaluate("window.table = document.querySelector('#synthesise table.sortable')")
    for _ in range(2):
        page.evaluate("table.tHead.rows[0].cells[2].querySelector('button').click()")
        assert (
            page.evaluate(
                "table.tBodies[0].rows[table.tBodies[0].rows.length - 1].cells[2].textContent"
            )
            == "–"
        )


def test_csv_holds_full_numbers_and_no_formulas(page: Browser) -> None:
    words = page.evaluate("csv(document.querySelector('#validate table.sortable'))")
    assert words.splitlines()[0] == "model,n,J,J/J0,X,Y,Z,K,M,N"
    assert words.splitlines()[1].startswith("Linear,36,2.48,0.62,")
    page.evaluate("window.made = document.createElement('table')")
    page.evaluate(
        "made.innerHTML = '<thead><tr><th>a<th>b</thead><tr><td data-v==1+1><td data-v=-2.5></tr>'"
    )
    assert page.evaluate("csv(made)") == "a,b\n'=1+1,-2.5\n"


def test_theme_button_switches(page: Browser) -> None:
    ground = "getComputedStyle(document.body).backgroundColor"
    before = page.evaluate(ground)
    page.evaluate("document.getElementById('theme').click()")
    assert page.evaluate(ground) != before


def test_everything_that_acts_is_reached_by_keyboard(page: Browser) -> None:
    unreachable = page.evaluate(
        "[...document.querySelectorAll('button, .frame, .scroll, summary, a[href]')].filter(item =>"
        " item.tabIndex < 0).length"
    )
    assert unreachable == 0


def test_links_of_the_contents_lead_to_a_heading(page: Browser) -> None:
    missing = page.evaluate(
        "[...document.querySelectorAll('nav a')].filter(a =>"
        " !document.getElementById(a.hash.slice(1))).length"
    )
    assert missing == 0


def test_page_prints(page: Browser) -> None:
    document = page.pdf()
    assert len(re.findall(rb"/Type\s*/Page\b", document)) >= 3


def test_equation_has_its_accents(page: Browser) -> None:
    tall = page.evaluate("document.querySelector('mover').getBoundingClientRect().height")
    bare = page.evaluate(
        "document.querySelector('mover > :first-child').getBoundingClientRect().height"
    )
    assert tall > bare
