"""Count the package's lines of code per folder: `python scripts/tools/count_lines.py [FOLDER]` prints a table.

Blank lines, comments and docstrings do not count. With --check the exit code is 1 where the package has more than `MOST` lines.
"""

import sys
import tokenize
from collections import Counter
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[2] / "robot_retarget"
MOST = 39_168
"""Lines of the package; a change that needs more removes others, and one that needs fewer lowers this number."""
LAYOUT = (tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT)


def code_lines(path: Path) -> int:
    """Return the number of lines with code in a file."""
    rows, before = set[int](), None
    with path.open("rb") as file:
        for token in tokenize.tokenize(file.readline):
            docstring = token.type == tokenize.STRING and before in (None, tokenize.ENCODING, *LAYOUT)
            if not docstring and token.type not in (*LAYOUT, tokenize.COMMENT, tokenize.ENCODING, tokenize.ENDMARKER):
                rows.update(range(token.start[0], token.end[0] + 1))
            before = token.type if token.type != tokenize.COMMENT else before
    return len(rows)


def per_folder(package: Path) -> Counter[str]:
    """Return the lines of code of each folder directly below a package, and of its own modules."""
    lines = Counter[str]()
    for path in package.rglob("*.py"):
        inner = path.relative_to(package).parts
        lines[inner[0] if len(inner) > 1 else "."] += code_lines(path)
    return lines


def main() -> None:
    """Print the table, largest folder first."""
    folders = [argument for argument in sys.argv[1:] if not argument.startswith("-")]
    lines = per_folder(Path(folders[0]) if folders else PACKAGE)
    for folder, count in [*lines.most_common(), ("total", lines.total())]:
        print(f"{folder:<14}{count:>8,}")
    if "--check" in sys.argv and lines.total() > MOST:
        sys.exit(f"{lines.total():,} lines of code, more than the {MOST:,} of scripts/tools/count_lines.py")


if __name__ == "__main__":
    main()
