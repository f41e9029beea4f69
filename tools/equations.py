"""Write docs/equations.md: which function implements which equation of which thesis.

A docstring gives an equation by its number in parentheses: (2.44), (2.84)-(2.92),
(2.13, corrected). The thesis is the one that the docstring of the module names first
("Equations of McCarter 2014."), unless one is named with the number: Alberti (59),
(McCarter 2.91-2.92).

    python tools/equations.py [CHECKOUT]
"""

from __future__ import annotations

import argparse
import ast
import re
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

FLOORS = ("hydro", "stages")
PAGE = "docs/equations.md"
THESES: Mapping[str, str] = {
    "McCarter": "McCarter 2014 (VT 690)",
    "Alberti": "Alberti 2015 (THAUS, REMUS)",
    "Al Makdah": "Al Makdah 2016 (H-AUV)",
}
LAST: Mapping[str, Mapping[str, int]] = {
    "McCarter": {"2": 94, "3": 44, "4": 27, "A": 7, "C": 12},
    "Alberti": {"": 71},
    "Al Makdah": {"2": 89, "3": 25, "5": 9},
}
"""Last equation number of each chapter; Alberti numbers through."""
NAME = r"(?P<name>McCarter|Alberti|Al Makdah)(?: 20\d\d)?"
NUMBER = r"(?:[A-D]\.\d+|\d+\.\d+|\d+)"
MENTION = re.compile(
    rf"(?:{NAME},? )?(?<![\w)])\((?:{NAME.replace('name', 'inner')},? )?"
    rf"(?P<numbers>{NUMBER}(?:(?:-|, ){NUMBER})*)(?P<corrected>, corrected[^()]*)?\)"
)
HEAD = """# Where each equation is

Written by `make declarations` from the docstrings of `hydro/` and `stages/`: edit
those, not this page. A number appears once for every function or class that implements
it. What differs from the print is marked *corrected*.
"""


@dataclass(frozen=True)
class Place:
    """A function, class or module that implements an equation."""

    file: str
    name: str
    summary: str
    corrected: bool = False


@dataclass(frozen=True, order=True)
class Equation:
    """An equation number: chapter ("2", "C"; empty where numbers run through) and number."""

    thesis: str
    chapter: str
    number: int

    def __str__(self) -> str:
        return f"({self.chapter}.{self.number})" if self.chapter else f"({self.number})"

    @property
    def exists(self) -> bool:
        """Whether the thesis has an equation of this number."""
        return 1 <= self.number <= LAST[self.thesis].get(self.chapter, 0)


def documented(tree: ast.Module) -> Iterator[tuple[str, str]]:
    """Yield name and docstring of the module (name empty) and of all it defines."""
    yield "", ast.get_docstring(tree) or ""

    def below(node: ast.AST, prefix: str) -> Iterator[tuple[str, str]]:
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.FunctionDef | ast.ClassDef):
                name = f"{prefix}{child.name}"
                yield name, ast.get_docstring(child) or ""
                yield from below(child, f"{name}.")

    yield from below(tree, "")


def joined(text: str) -> str:
    """Return a text in one line, (2.84)-(2.92) as (2.84-2.92)."""
    return re.sub(r"\)- ?\(", "-", " ".join(text.split()))


def equations_in(text: str, thesis: str | None) -> Iterator[tuple[Equation, bool]]:
    """Yield the equations that a docstring gives, and whether as corrected.

    `thesis`: the one that the module names. Raises `ValueError` for a number of no thesis.
    """
    for mention in MENTION.finditer(joined(text)):
        own = mention["name"] or mention["inner"] or thesis
        numbers = mention["numbers"]
        plain = "." not in numbers
        # Integers are equations of Alberti only, and (6, 6) is a shape.
        if plain and (own != "Alberti" or ", " in numbers):
            continue
        if own is None:
            raise ValueError(f"({numbers}) is of no thesis: name one in the module's docstring")
        for part in numbers.split(", "):
            ends = [end.rpartition(".") for end in part.split("-")]
            first, last = ends[0], ends[-1]
            for number in range(int(first[2]), int(last[2]) + 1):
                equation = Equation(own, first[0], number)
                if not equation.exists or first[0] != last[0]:
                    raise ValueError(f"{THESES[own]} has no equation ({part})")
                yield equation, mention["corrected"] is not None


def equation_index(root: Path) -> dict[Equation, list[Place]]:
    """Return every equation with its places: functions and classes, else the module.

    Raises `ValueError` that lists all numbers of no thesis, with file and name.
    """
    index: dict[Equation, list[Place]] = defaultdict(list)
    modules: dict[Equation, list[Place]] = defaultdict(list)
    faults = []
    for path in sorted(path for floor in FLOORS for path in (root / floor).rglob("*.py")):
        file = path.relative_to(root).as_posix()
        source = path.read_text(encoding="utf-8")
        if not MENTION.search(joined(source)):  # parsing takes ten times as long
            continue
        docstrings = list(documented(ast.parse(source)))
        first = re.search(NAME, docstrings[0][1])
        for name, text in docstrings:
            summary = " ".join(text.partition("\n\n")[0].split())
            try:
                equations = dict(equations_in(text, first["name"] if first else None))
            except ValueError as error:
                faults.append(f"{file}: {name or 'module'}: {error}")
                continue
            for equation, corrected in equations.items():
                target = index if name else modules
                target[equation].append(Place(file, name, summary, corrected))
    if faults:
        raise ValueError("\n".join(faults))
    return {**modules, **index}


def page(index: Mapping[Equation, list[Place]]) -> str:
    """Return the text of docs/equations.md."""
    lines = [HEAD]
    for thesis, title in THESES.items():
        lines += [f"## {title}\n", "| equation | where | file | what |", "|---|---|---|---|"]
        for equation in sorted(item for item in index if item.thesis == thesis):
            for place in index[equation]:
                note = " *corrected*" if place.corrected else ""
                what = place.summary.replace("|", "\\|")
                name = f"`{place.name}`" if place.name else "module"
                link = f"[{place.file}](../{place.file})"
                lines.append(f"| {equation}{note} | {name} | {link} | {what} |")
        lines.append("")
    return "\n".join(lines)


def main() -> None:
    """Write the page."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument(
        "checkout", nargs="?", type=Path, default=Path(__file__).resolve().parents[1]
    )
    root = parser.parse_args().checkout.resolve()
    try:
        (root / PAGE).write_text(page(equation_index(root)), encoding="utf-8")
    except ValueError as error:
        raise SystemExit(str(error)) from None


if __name__ == "__main__":
    main()
