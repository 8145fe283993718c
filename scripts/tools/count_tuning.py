"""Count the package's numbers by their origin: `python scripts/tools/count_tuning.py [--list] [FOLDER …]`.

A number is a module constant, or the default of a class's field, other than 0, 1, −1 and tuples or tables of these alone. The docstring below it decides; one
that ends in "..." goes on in the next.

- fact: of a format, a protocol, a register, an exit code, a picture or a paper (`FACTS`, `FACT`), a member of an enumeration, or a rounding error.
- bound: what lies beyond is refused, or named as a mistake.
- derived: an expression of other names.
- sourced: the docstring cites a publication, a data sheet, a library or a measurement (`SOURCE`), states the results with half and with double the
  value (`PAIR`), or compares with another figure and says of what it is (`FIGURE`, `NAMED`). A figure alone is no source.
- without: the rest, and every number whose half and double change nothing (`effectless`). `--list` prints them. With --check the exit code is 1
  where there are more than `MOST`.
"""

import ast
import re
import sys
from collections import Counter
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[2] / "robot_retarget"
MOST = 187
"""Numbers without a source; a change that adds one removes or explains another, and one that explains more lowers this number."""
FACTS = (
    "papers/",
    "formats/",
    "tools/",
    "servo/protocol.py",
    "servo/emulator/registers.py",
    "base/untrusted/",
    "actuators/control_tables.py",
)
"""Folders and modules that hold facts alone: papers, file formats, pictures and pages, registers, limits of files."""
FACT = re.compile(
    r"[Bb]ytes|\[B\]|[Aa]ddress|[Bb]its? |[Cc]olumns|Colour|[Ii]ndex|[Rr]egister|[Ff]ormat|[Pp]rotocol|Linux|unit|units|"
    r"Largest slope|[Ee]xit code|[Kk]eypoint|[Rr]ounding|Contact type|frame and|A frame, |One frame|definition|data set"
)
BOUND = re.compile(r"mistake|refused|is no rotation|is none|damage|progress counts|listed|believed")
SOURCE = re.compile(
    r"\[[A-Z][A-Za-z]+\d{4}\]|measured|median|comparison|[Dd]ata ?sheet|manual|MuJoCo|librar|[Aa]s (?:in |for |of )?`"
)
MEASURED = re.compile(r"[Mm]easured|[Dd]ata ?sheet|\[[A-Z][A-Za-z]+\d{4}\]")
"""In the docstring of a class, for all its fields."""
PAIR = re.compile(r"\([^()\d]*(\d[\d.]*)[,;] (\d[\d.]*)")
"""Results with half and with double the value, as the docstring of the class says ..."""
EACH = re.compile(r"(\d[\d.]*)[,;] (\d[\d.]*)")
"""... and each pair of them, of one figure after the other."""
FIGURE = re.compile(r"(?<![A-Za-z_\d])\d")
"""Another figure, outside brackets."""
NAMED = re.compile(
    r"`|\b(?:OP3|G1|T1|ToddlerBot|Poppy|OpenCR|XM\d+|MPU-\d+|SMPL|LAFAN1|CMU)\b|"
    r"\b(?:clip|walk|stream|dance|kick|wave|clap|capture|exporter|robot|servo|take)s?\b|[Ww]ith (?:half|double|none|\d)|[Tt]wice|times the"
)
"""What such a figure is of: a robot, a servo, a recording, or another value of the number."""
HALVED = re.compile(r"(?:[^.;]|\.(?=\d))*[Hh]alf(?:[^.]|\.(?=\d))*")
"""The sentence about half and double."""
UNCHANGED = re.compile(r"\b(?:nothing|neither|none|the same|(?:do|does) not change|no (?:stream|contact|clip))\b")
CHANGED = re.compile(
    r"\bby (?!less|nothing)[-−]?\d|instead of|in place of|\d and \d|lower|raise|\d° further|"
    r"(?:[Hh]alf|double) (?:loses|adds|changes (?:one|the \w+ of \d))"
)
"""An effect of one side is one: it bounds the number on that side."""


def is_number(node: ast.expr) -> bool:
    """Whether an expression is made of numbers alone, or is a field with a default made of them."""
    match node:
        case ast.Constant(value):
            return isinstance(value, int | float) and not isinstance(value, bool)
        case ast.UnaryOp() | ast.BinOp():
            return all(is_number(child) for child in ast.iter_child_nodes(node) if isinstance(child, ast.expr))
        case ast.Tuple(elements) | ast.Dict(values=elements):
            return bool(elements) and all(map(is_number, elements))
        case ast.Call(keywords=keywords):
            return any(keyword.arg == "default" and is_number(keyword.value) for keyword in keywords)
    return False


def is_derived(node: ast.expr) -> bool:
    """Whether an expression computes with a number and a name."""
    parts = list(ast.walk(node))
    return isinstance(node, ast.BinOp) and any(isinstance(part, ast.Name | ast.Attribute) for part in parts)


def docstring(node: ast.stmt) -> str | None:
    """Return the text of a statement that is a string alone."""
    text = node.value.value if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) else None
    return " ".join(text.split()) if isinstance(text, str) else None


def documented(body: list[ast.stmt]) -> Iterator[tuple[str, ast.expr, str]]:
    """Yield name, value and docstring of every assignment of a body."""
    for (node, after), k in zip(pairwise([*body, ast.Pass()]), range(len(body)), strict=True):
        if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None:
            target, text = node.targets[0] if isinstance(node, ast.Assign) else node.target, docstring(after) or "..."
            for later in body[k + 2 :]:
                text += f" {more}" if text.endswith("...") and (more := docstring(later)) else ""
            yield ast.unparse(target), node.value, text


def origin(module: str, value: ast.expr, text: str, about: str = "") -> str | None:
    """Return where a number comes from; None for what is no number."""
    if is_derived(value):
        return "derived"
    if not is_number(value):
        return None
    default = (
        next((k.value for k in value.keywords if k.arg == "default"), value) if isinstance(value, ast.Call) else value
    )
    leaves = [part.value for part in ast.walk(default) if isinstance(part, ast.Constant) and part.value not in (0, 1)]
    if not leaves:
        return None
    if (
        module.startswith(FACTS)
        or all(isinstance(leaf, float) and leaf <= 1e-9 for leaf in leaves)
        or FACT.search(text)
    ):
        return "fact"
    if BOUND.search(text):
        return "bound"
    if effectless(text):
        return "without"
    figure = FIGURE.search(re.sub(r"\[[^]]*\]", "", text)) and NAMED.search(text)
    return "sourced" if MEASURED.search(about) or SOURCE.search(text) or PAIR.search(text) or figure else "without"


def effectless(text: str) -> bool:
    """Whether a docstring says that half and double of the number change nothing."""
    said, pair = HALVED.search(text), PAIR.search(text)
    unchanged = said is not None and UNCHANGED.search(said.group()) and not CHANGED.search(said.group())
    pairs = EACH.findall(text[pair.start() :].partition(")")[0]) if pair else []
    return bool(unchanged or (pairs and all(float(a.rstrip(".")) == float(b.rstrip(".")) for a, b in pairs)))


def numbers(module: Path) -> Iterator[tuple[str, str]]:
    """Yield the name and the origin of every number of a module."""
    path = module.relative_to(PACKAGE).as_posix()
    body = ast.parse(module.read_text(encoding="utf-8")).body
    scopes = [("", body, "")] + [
        (f"{c.name}.", c.body, ast.get_docstring(c) or "") for c in body if isinstance(c, ast.ClassDef)
    ]
    bases = {c.name: "".join(map(ast.unparse, c.bases)) for c in body if isinstance(c, ast.ClassDef)}
    for scope, statements, about in scopes:
        for name, value, text in documented(statements):
            if (found := origin(path, value, text, about)) is not None:
                member = re.search("Enum|Flag", bases.get(scope[:-1], ""))
                yield f"{path}: {scope}{name} = {ast.unparse(value)}", "fact" if member else found


def main() -> None:
    """Print a row per folder, and the sum."""
    folders = [argument for argument in sys.argv[1:] if not argument.startswith("-")]
    total, rows = Counter[str](), list[str]()
    for folder in folders or sorted({path.relative_to(PACKAGE).parts[0] for path in PACKAGE.rglob("*.py")}):
        paths = sorted((PACKAGE / folder).rglob("*.py")) if (PACKAGE / folder).is_dir() else [PACKAGE / folder]
        found = [number for path in paths for number in numbers(path)]
        counts = Counter(kind for _, kind in found)
        total, rows = total + counts, rows + [name for name, kind in found if kind == "without"]
        print(
            f"{folder:<14}",
            *(f"{kind} {counts[kind]:<5}" for kind in ("fact", "bound", "derived", "sourced", "without")),
        )
    print(f"{'all':<14}", *(f"{kind} {total[kind]:<5}" for kind in ("fact", "bound", "derived", "sourced", "without")))
    if "--list" in sys.argv:
        print(*rows, sep="\n")
    if "--check" in sys.argv and total["without"] > MOST:
        sys.exit(f"{total['without']} numbers without a source, more than the {MOST} of scripts/tools/count_tuning.py")


if __name__ == "__main__":
    main()
