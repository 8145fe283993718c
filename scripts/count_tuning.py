"""Count tuning values of the core: `python scripts/count_tuning.py [FOLDER …]` prints a Markdown table.

Three kinds count: module constants that are numbers, numeric defaults of the fields of options classes, and numbers written
in function bodies other than those of `ARITHMETIC`. Indices, shapes and docstrings do not count.
"""

import argparse
import ast
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[1] / "robot_retarget"
CORE = ("motion", "human", "robot", "describe", "dgp", "solve", "collision", "balance")
READERS = "formats"
"""Folders of readers hold the numbers of file formats, which are facts."""
ARITHMETIC = {0, 1, 2, 3, 0.5, -1, 4, 6, 12, 180, 360}
"""Numbers of formulas: dimensions, halves, degrees, twelve coordinates of two by six."""


def numeric(node: ast.expr | None) -> bool:
    """Whether an expression is made of numbers alone."""
    if isinstance(node, ast.Constant):
        return isinstance(node.value, int | float) and not isinstance(node.value, bool)
    if isinstance(node, ast.UnaryOp | ast.BinOp):
        return all(numeric(child) for child in ast.iter_child_nodes(node) if isinstance(child, ast.expr))
    return isinstance(node, ast.Tuple) and bool(node.elts) and all(map(numeric, node.elts))


def inline(tree: ast.AST) -> Iterator[float]:
    """Floats in function bodies."""
    for function in ast.walk(tree):
        if isinstance(function, ast.FunctionDef):
            for statement in function.body:
                for node in ast.walk(statement):
                    if (
                        isinstance(node, ast.Constant)
                        and isinstance(node.value, float)
                        and node.value not in ARITHMETIC
                    ):
                        yield node.value


def counts(path: Path) -> Counter[str]:
    """The tuning values of one module, by kind."""
    tree, found = ast.parse(path.read_text(encoding="utf-8")), Counter[str]()
    for node in tree.body:
        value = node.value if isinstance(node, ast.Assign | ast.AnnAssign) else None
        found["constants"] += numeric(value)
        if isinstance(node, ast.ClassDef):
            fields = (item for item in node.body if isinstance(item, ast.AnnAssign))
            found["option defaults"] += sum(numeric(item.value) for item in fields)
    found["inline floats"] += sum(1 for _ in inline(tree))
    return found


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
        paths = [path for path in sorted((PACKAGE / folder).rglob("*.py")) if READERS not in path.parts[:-1]]
        groups = {str(path.relative_to(PACKAGE)): [path] for path in paths} if given.files else {folder: paths}
        for name, group in groups.items():
            found = sum((counts(path) for path in group), Counter())
            size = sum(len(path.read_text(encoding="utf-8").splitlines()) for path in group)
            total, lines = total + found, lines + size
            print(f"| {name} | {size} | " + " | ".join(str(found[kind]) for kind in kinds) + f" | {found.total()} |")
    print(f"| all | {lines} | " + " | ".join(str(total[kind]) for kind in kinds) + f" | {total.total()} |")


if __name__ == "__main__":
    main()
