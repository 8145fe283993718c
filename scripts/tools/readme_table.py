"""Write the table of tested robots into README.md and README.zh.md from the recorded tables of benchmarks/.

python scripts/tools/readme_table.py            # write both
python scripts/tools/readme_table.py --demo     # run the demo too, and write its output
python scripts/tools/readme_table.py --check    # exit 1 where a README states something else
"""

import re
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
BEGIN, END = "<!-- tested: scripts/tools/readme_table.py -->", "<!-- /tested -->"
ROBOTS = {
    "robotis_op3": "ROBOTIS OP3",
    "unitree_g1": "Unitree G1",
    "unitree_h1": "Unitree H1",
    "booster_t1": "Booster T1",
    "toddlerbot_2xc": "ToddlerBot",
}
HEADS = {
    "README.md": (
        "| robot | angle of limbs to the human's | jerk [rad/s³] | stands free in simulation |",
        ("{} passed", "{} passed but unlike the human", "{} not playable standing", "{} failed", ", of {} clips"),
        "not tested",
        "Means over eleven public clips, recorded on {solved}; the OP3-class robot stands free on its servos, recorded on {stood}.",
    ),
    "README.zh.md": (
        "| 机器人 | 肢体与人的夹角 | 加加速度 [rad/s³] | 仿真中自由站立 |",
        ("{} 个通过", "{} 个通过但与人不像", "{} 个无法站立完成", "{} 个失败", "（共 {} 个动作）"),
        "未测试",
        "十一个公开动作的平均值，记录于 {solved}；OP3 级机器人在其舵机上自由站立，记录于 {stood}。",
    ),
}
"""Per README: head of the table, the parts of a cell with verdicts, a cell without, and the sentence below."""
VERDICTS = (("pass", "pass, at the edge"), ("pass, but unlike",), ("not playable standing",), ("fail",))
"""The verdicts that each part of a cell counts."""


def rows(page: Path, heading: str, column: str) -> list[dict[str, str]]:
    """Return the rows of the first table below a heading that has a column, by column."""
    text = page.read_text(encoding="utf-8").split(f"## {heading}\n", 1)[1]
    for block in re.findall(r"(?:^\|.*\n)+", text, re.MULTILINE):
        names, _, *cells = [re.split(r"\s*\|\s*", line.strip("| ")) for line in block.splitlines()]
        if column in names:
            return [dict(zip(names, row, strict=False)) for row in cells]
    return []


def recorded(page: Path, heading: str) -> str:
    """Return the date on which the table below a heading was recorded."""
    text = page.read_text(encoding="utf-8").split(f"## {heading}\n", 1)[1]
    found = re.search(r"[Rr]ecorded on (\d{4}-\d\d-\d\d)", text)
    return found[1] if found else ""


def table(readme: str) -> str:
    """Return the block of a README."""
    head, verdicts, none, below = HEADS[readme]
    suite, upright = ROOT / "benchmarks/retargeting.md", ROOT / "benchmarks/balance.md"
    solved, stood = "Eleven clips on five robots", "Clips that stay upright"
    free = verdict_cell(verdicts, [row["verdict"] for row in rows(upright, stood, "verdict")])
    lines = [head, "|---|---|---|---|"]
    for row in rows(suite, solved, "limbs"):
        cell = free if row["robot"] == "robotis_op3" else none
        lines.append(f"| {ROBOTS[row['robot']]} | {row['limbs']}° | {row['jerk']} | {cell} |")
    return "\n".join([*lines, "", below.format(solved=recorded(suite, solved), stood=recorded(upright, stood))])


def verdict_cell(parts: tuple[str, ...], verdicts: list[str]) -> str:
    """Return how many clips have each kind of verdict; kinds without any are left out.

    Raises:
        ValueError: a verdict that no part counts.
    """
    counted = Counter(verdict.split(" (")[0] for verdict in verdicts)
    if strange := counted.keys() - {name for names in VERDICTS for name in names}:
        raise ValueError(f"no part of the table counts the verdict {sorted(strange)[0]!r}")
    counts = [sum(counted[name] for name in names) for names in VERDICTS]
    comma = "，" if parts[-1].startswith("（") else ", "
    named = comma.join(part.format(count) for part, count in zip(parts, counts, strict=False) if count)
    return named + parts[-1].format(len(verdicts))


def demo_block() -> str:
    """Run the demo and return what a README shows of its output."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "robot_retarget", "demo", "--out", "demo"]
        lines = subprocess.run(command, cwd=folder, capture_output=True, text=True).stdout.splitlines()
    first = next(k for k, line in enumerate(lines) if line.startswith("verdict: "))
    last = [line for line in lines if line.startswith(("played ", "wrote ", "next: "))]
    return "\n".join([*lines[first : first + 3], "…", *last])


def written(readme: str, demo: str = "") -> str:
    """Return a README with its blocks made anew."""
    text = (ROOT / readme).read_text(encoding="utf-8")
    if demo:
        text = re.sub(r"```text\nverdict: .*?```", lambda _: f"```text\n{demo}\n```", text, count=1, flags=re.DOTALL)
    before, rest = text.split(BEGIN, 1)
    return f"{before}{BEGIN}\n\n{table(readme)}\n\n{END}{rest.split(END, 1)[1]}"


def main() -> int:
    """Write or check both files."""
    demo = demo_block() if "--demo" in sys.argv[1:] else ""
    stale = [readme for readme in HEADS if written(readme, demo) != (ROOT / readme).read_text(encoding="utf-8")]
    if "--check" in sys.argv[1:]:
        print("\n".join(f"{readme}: run python scripts/tools/readme_table.py" for readme in stale))
        return int(bool(stale))
    for readme in stale:
        (ROOT / readme).write_text(written(readme, demo), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
