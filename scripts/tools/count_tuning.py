"""Count tuning values of the core: `python scripts/tools/count_tuning.py [FOLDER …]` prints a Markdown table.

Three kinds count: module constants (a number, a tuple of numbers, or each value of a dictionary), numeric defaults of the
fields of classes, and floats in function bodies. These do not count, because another value would be wrong and not worse:

- numbers of `ARITHMETIC`, which belong to formulas;
- numbers up to `ROUNDING`, which guard divisions and compare what is equal;
- the field default 0, which stands for nothing;
- constants and fields whose docstring cites a source, such as [Winter2009];
- `READERS`, `FIGURES` and `FACTS`: numbers of file formats, of the scenes in the papers' figures, of frames and versions.

Integers in function bodies do not count either: most are indices, powers and strides. Weights belong into constants.
"""

import argparse
import ast
import re
from collections import Counter
from pathlib import Path
from typing import TypeGuard

PACKAGE = Path(__file__).resolve().parents[2] / "robot_retarget"
CORE = ("motion", "human", "robot", "graph", "solve", "collision", "balance")
READERS = "formats"
"""Folders that hold the numbers of file formats, which are facts; their lines do not count either."""
FIGURES = {"scenes.py", "body.py", "instances.py"}
"""Modules that hold the numbers of the papers' figures."""
FACTS = {"role.py", "versions.py"}
"""Modules that hold the frames that an edge joins, and versions of other packages."""
ARITHMETIC = {0, 1, 2, 3, 0.5, 4, 6, 12, 90, 180, 270, 360}
"""Numbers of formulas: dimensions, halves, degrees, twelve coordinates of two by six."""
ROUNDING = 1e-9
"""Numbers up to this separate zero from rounding errors."""
CITATION = re.compile(r"\[[A-Z][A-Za-z]+\d{4}\]")


def numbers(node: ast.expr | None) -> int:
    """Return how many tuning values an expression of numbers holds; 0 for any other expression."""
    if isinstance(node, ast.Dict):
        return sum(map(numbers, node.values))
    if isinstance(node, ast.Call):
        inner = next((k.value for k in node.keywords if k.arg == "default_factory"), None)
        return numbers(inner.body) if isinstance(inner, ast.Lambda) else 0
    return int(numeric(node) and not all(rounding(leaf) for leaf in ast.walk(node) if isinstance(leaf, ast.Constant)))


def numeric(node: ast.expr | None) -> TypeGuard[ast.expr]:
    """Whether an expression is made of numbers alone."""
    if isinstance(node, ast.Constant):
        return isinstance(node.value, int | float) and not isinstance(node.value, bool)
    if isinstance(node, ast.UnaryOp | ast.BinOp):
        return all(numeric(child) for child in ast.iter_child_nodes(node) if isinstance(child, ast.expr))
    return isinstance(node, ast.Tuple) and bool(node.elts) and all(map(numeric, node.elts))


def rounding(leaf: ast.Constant) -> bool:
    """Whether a number separates zero from rounding errors."""
    return isinstance(leaf.value, float) and 0 < leaf.value <= ROUNDING


def inline(tree: ast.AST) -> int:
    """Return the number of floats in function bodies."""
    bodies = [statement for f in ast.walk(tree) if isinstance(f, ast.FunctionDef) for statement in f.body]
    leaves = {node for body in bodies for node in ast.walk(body) if isinstance(node, ast.Constant)}
    return sum(isinstance(x.value, float) and x.value not in ARITHMETIC and not rounding(x) for x in leaves)


def constants(tree: ast.Module) -> int:
    """Return the number of tuning values among the constants of a module."""
    return sum(map(numbers, chosen(tree.body)))


def chosen(body: list[ast.stmt]) -> list[ast.expr | None]:
    """Return the values that a body assigns, without those whose docstring cites a source."""
    values = []
    for node, after in zip(body, [*body[1:], None], strict=True):
        text = after.value.value if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant) else ""
        if isinstance(node, ast.Assign | ast.AnnAssign) and not CITATION.search(str(text)):
            values.append(node.value)
    return values


def defaults(tree: ast.Module) -> int:
    """Return the number of tuning values among the defaults of fields."""
    classes = [node for node in tree.body if isinstance(node, ast.ClassDef)]
    values = [v for c in classes for v in chosen([item for item in c.body if not isinstance(item, ast.Assign)])]
    return sum(numbers(v) for v in values if not (isinstance(v, ast.Constant) and v.value == 0))


def counts(path: Path) -> Counter[str]:
    """Return the tuning values of one module, by kind."""
    if path.name in FIGURES | FACTS:
        return Counter()
    tree = ast.parse(path.read_text(encoding="utf-8"))
    found = {"constants": constants(tree), "option defaults": defaults(tree), "inline floats": inline(tree)}
    return Counter(found)


def main() -> None:
    """Print a row per folder and the sum."""
    ask = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ask.add_argument("folders", nargs="*", default=CORE, help="folders of the package")
    ask.add_argument("--files", action="store_true", help="a row for every module")
    given = ask.parse_args()
    kinds = ("constants", "option defaults", "inline floats")
    print("| folder | lines | " + " | ".join(kinds) + " | values |\n|" + "---|" * 6)
    total, lines = Counter[str](), 0
    for folder in given.folders:
        paths = [path for path in sorted((PACKAGE / folder).rglob("*.py")) if READERS not in path.parts]
        groups = {str(path.relative_to(PACKAGE)): [path] for path in paths} if given.files else {folder: paths}
        for name, group in groups.items():
            found = sum((counts(path) for path in group), Counter())
            size = sum(len(path.read_text(encoding="utf-8").splitlines()) for path in group)
            total, lines = total + found, lines + size
            print(f"| {name} | {size} | " + " | ".join(str(found[kind]) for kind in kinds) + f" | {found.total()} |")
    print(f"| all | {lines} | " + " | ".join(str(total[kind]) for kind in kinds) + f" | {total.total()} |")


if __name__ == "__main__":
    main()
