"""Which folders make the package `auvid`, and which files besides Python travel with
it.

The floors lie at the top of the repository; installed, they are subpackages of `auvid`,
and nothing else of ours reaches site-packages (docs/decisions/0014-one-package.md). All
else is in pyproject.toml.
"""

from setuptools import find_namespace_packages, setup

FLOORS = ("data_schemas", "hydro", "stages", "export", "pipeline", "vehicles")


def packages_of(floor: str) -> list[str]:
    """Return the packages of one floor by their installed names."""
    inside = find_namespace_packages(floor, exclude=["*__pycache__*", "templates*"])
    return [f"auvid.{floor}", *(f"auvid.{floor}.{name}" for name in inside)]


setup(
    packages=["auvid", *(name for floor in FLOORS for name in packages_of(floor))],
    package_dir={"auvid": "auvid", **{f"auvid.{floor}": floor for floor in FLOORS}},
    package_data={
        "": ["*.yaml", "*.css", "*.js", "*.html", "*.j2", "*.csv", "py.typed"],
        "auvid.pipeline": ["templates/**"],
        "auvid.stages.page": ["templates/**"],
    },
)
