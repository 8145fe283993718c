"""The oldest versions that the package accepts, as pip constraints: each lower bound of pyproject.toml, pinned.

python scripts/tools/lowest_versions.py > lowest.txt
pip install -c lowest.txt '.[plots,video,view]'
"""

import re
import tomllib
from pathlib import Path

PYPROJECT = Path(__file__).resolve().parents[2] / "pyproject.toml"
EXTRAS = ("plots", "video", "view")
"""Extras that are installed besides."""


def lowest(requirement: str) -> str:
    """The constraint `name==version.*` of a requirement `name>=version` or `name>=version,<version`, which takes the newest patch of it."""
    found = re.fullmatch(r"([\w.-]+)(?:\[[\w,]+\])?>=([\d.]+)(?:,<[\d.]+)?", requirement)
    if found is None:
        raise ValueError(f"{requirement!r} states no lower bound")
    return f"{found[1]}=={found[2]}.*"


def main() -> None:
    project = tomllib.loads(PYPROJECT.read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    for requirement in [*project["dependencies"], *(line for extra in EXTRAS for line in extras[extra])]:
        print(lowest(requirement))


if __name__ == "__main__":
    main()
