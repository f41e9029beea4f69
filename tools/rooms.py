"""Print rooms, levels and arrows of each product folder.

A room is a file or folder directly in the folder that is looked at; an arrow is an
import from one room to another. A level is a floor of the rooms: a room stands one
level above the highest room that it imports. A circle is a set of files that import
each other in a ring; a climb is an arrow between two rooms that also import each other,
so that neither can stand below the other.

    python tools/rooms.py [CHECKOUT] [--arrows]
"""

from __future__ import annotations

import argparse
import ast
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from auvid.pipeline.store.import_closure import scan_source

PRODUCT = ("data_schemas", "hydro", "stages", "export", "pipeline")
"""The floors, lowest first."""
PACKAGE = "auvid"


@dataclass(frozen=True)
class Folder:
    """What stands directly in one folder."""

    path: str
    rooms: tuple[str, ...]
    levels: int
    arrows: tuple[tuple[str, str], ...]
    climbs: tuple[tuple[str, str], ...]


def module_files(root: Path) -> dict[str, Path]:
    """Return every module of the product: dotted name without the package -> file."""
    files = {}
    for floor in PRODUCT:
        for path in sorted((root / floor).rglob("*.py")):
            parts = path.relative_to(root).with_suffix("").parts
            files[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return files


def imported(name: str, files: Mapping[str, Path]) -> set[str]:
    """Return the modules of the product that one module imports (type checking
    included).
    """
    path = files[name]
    package = name if path.name == "__init__.py" else name.rpartition(".")[0]
    modules = set()
    source = path.read_bytes().replace(b"if TYPE_CHECKING:", b"if True:")
    for node in scan_source(source).imports:
        if isinstance(node, ast.Import):
            targets = [alias.name for alias in node.names]
        else:
            above = package.split(".")[: len(package.split(".")) - node.level + 1]
            base = (
                ".".join([*above, node.module or ""]).strip(".")
                if node.level
                else node.module or ""
            )
            base = base.removeprefix(f"{PACKAGE}.")
            members = [f"{base}.{alias.name}" for alias in node.names]
            targets = [member if member in files else base for member in members]
        modules |= {target.removeprefix(f"{PACKAGE}.") for target in targets} & set(files)
    return modules - {name}


@cache
def import_graph(root: Path) -> dict[str, set[str]]:
    """Return module -> modules of the product that it imports."""
    files = module_files(root)
    return {name: imported(name, files) for name in files}


def circles(graph: Mapping[str, Iterable[str]]) -> list[list[str]]:
    """Return the strongly connected components of more than one node (Tarjan 1972)."""
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    rings: list[list[str]] = []

    def visit(node: str) -> None:
        index[node] = low[node] = len(index)
        stack.append(node)
        for other in graph[node]:
            if other not in index:
                visit(other)
                low[node] = min(low[node], low[other])
            elif other in stack:
                low[node] = min(low[node], index[other])
        if low[node] == index[node]:
            ring = stack[stack.index(node) :]
            del stack[stack.index(node) :]
            if len(ring) > 1:
                rings.append(sorted(ring))

    for node in graph:
        if node not in index:
            visit(node)
    return rings


def folder_of(root: Path, folder: Path, graph: Mapping[str, Iterable[str]]) -> Folder:
    """Return rooms, levels, arrows and climbs of one folder."""
    inside = [
        path for path in sorted(folder.iterdir()) if not path.name.startswith((".", "__pycache__"))
    ]
    rooms = tuple(path.name for path in inside if path.name != "__init__.py")
    here = ".".join(folder.relative_to(root).parts)

    def room(module: str) -> str | None:
        if not module.startswith(f"{here}."):
            return None
        return module.removeprefix(f"{here}.").partition(".")[0]

    arrows = defaultdict(set)
    for name, targets in graph.items():
        start = room(name)
        for target in targets:
            end = room(target)
            if start and end and start != end:
                arrows[start].add(end)
    pairs = tuple(sorted((start, end) for start, ends in arrows.items() for end in ends))
    nodes = {
        path.stem
        for path in inside
        if path.stem != "__init__" and (path.is_dir() or path.suffix == ".py")
    }
    closed = {node: arrows[node] & nodes for node in nodes}
    rings = circles(closed)
    climbs = tuple(pair for pair in pairs if any(set(pair) <= set(ring) for ring in rings))
    depth: dict[str, int] = {}

    def height(node: str, above: frozenset[str] = frozenset()) -> int:
        if node not in depth:
            below = [height(other, above | {node}) for other in closed[node] if other not in above]
            depth[node] = 1 + max(below, default=0)
        return depth[node]

    return Folder(here.replace(".", "/"), rooms, max(map(height, nodes), default=0), pairs, climbs)


def folders(root: Path) -> list[Folder]:
    """Return every product folder of a checkout."""
    graph = import_graph(root)
    places = [
        place
        for floor in PRODUCT
        for place in [root / floor, *sorted((root / floor).rglob("*"))]
        if place.is_dir() and place.name != "__pycache__" and any(place.iterdir())
    ]
    return [folder_of(root, place, graph) for place in places]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "checkout", nargs="?", type=Path, default=Path(__file__).resolve().parents[1]
    )
    parser.add_argument("--arrows", action="store_true", help="list the arrows of each folder")
    options = parser.parse_args()
    root = options.checkout.resolve()
    print(f"{'folder':<44} rooms levels arrows climbs")
    for folder in folders(root):
        figures = (len(folder.rooms), folder.levels, len(folder.arrows), len(folder.climbs))
        print(f"{folder.path:<44} {figures[0]:5d} {figures[1]:6d} {figures[2]:6d} {figures[3]:6d}")
        for start, end in folder.arrows if options.arrows else folder.climbs:
            print(f"    {start} -> {end}{' climbs' if (start, end) in folder.climbs else ''}")
    for ring in circles(import_graph(root)):
        print("circle of files:", ", ".join(ring))


if __name__ == "__main__":
    main()
