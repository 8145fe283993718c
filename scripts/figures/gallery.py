"""A gallery: the sample clips on some robots, each as a strip of moments that leads to its page of the viewer.

    python scripts/figures/gallery.py op3 my_robot.xml unitree_g1.xml --out gallery

Robots are given as to `solve`. The folder opens without a server or a network: `index.html`, a page a clip that shows all
robots side by side, and a strip a robot.
"""

import argparse
import html
from pathlib import Path

import robot_retarget as rr
from robot_retarget.base.errors import RobotRetargetError
from robot_retarget.base.files import SAMPLES, folder, replacing
from robot_retarget.tools.view.film import strip
from robot_retarget.tools.view.picture import Picture
from robot_retarget.tools.view.web.viewer import Viewer, view

PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>robot-retarget: sample clips on {robots}</title>
<style>
:root {{ color-scheme: light dark; --ink: #1f2933; --faint: #616e7c; --line: #e4e7eb; --ground: #f5f7fa; --card: #fff; --link: #0b7285; }}
@media (prefers-color-scheme: dark) {{
  :root {{ --ink: #dfe4ea; --faint: #9aa5b1; --line: #323c47; --ground: #11161b; --card: #1b2229; --link: #3bc9db; }}
}}
body {{ margin: 0 auto; max-width: 1500px; padding: 24px; background: var(--ground); color: var(--ink); font: 15px/1.5 system-ui, sans-serif; }}
section {{ background: var(--card); border: 1px solid var(--line); border-radius: 10px; padding: 16px 20px; margin: 16px 0; }}
h1 {{ font-size: 22px; }} h2 {{ font-size: 17px; margin: 0 0 8px; }} a {{ color: var(--link); }}
figure {{ margin: 10px 0; }} img {{ width: 100%; border-radius: 6px; }} figcaption {{ color: var(--faint); font-size: 13px; }}
</style></head><body>
<p><a href="{back}">robot-retarget</a></p>
<h1>Sample clips on {robots}</h1>
<p>Every row leads to a page on which the clip is seen from all sides, with footholds, near pairs, limits and curves.</p>
{sections}
</body></html>
"""


def main() -> None:
    """Write the gallery."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("robots", nargs="+", help="shipped names, MJCF files or robot_descriptions names")
    parser.add_argument(
        "--clips", nargs="*", type=Path, default=sorted(SAMPLES.glob("*.bvh")), help="by default the samples"
    )
    parser.add_argument("--seconds", type=float, default=8.0, help="longest part of a clip [s]")
    parser.add_argument("--out", type=Path, default=Path("gallery"))
    parser.add_argument("--back", default="../index.html", help="address of the page that leads here")
    given = parser.parse_args()
    target, robots = folder(given.out), [rr.load_robot(name) for name in given.robots]
    sections = [_section(clip, robots, given.seconds, target) for clip in given.clips]
    names = html.escape(", ".join(robot.name for robot in robots))
    with replacing(target / "index.html") as scratch:
        scratch.write_text(
            PAGE.format(robots=names, back=html.escape(given.back), sections="\n".join(sections)), encoding="utf-8"
        )
    print(f"wrote {target / 'index.html'}")


def _section(path: Path, robots: list[rr.Robot], seconds: float, target: Path) -> str:
    """Return the section of a clip: a strip for each robot, or the reason for its absence."""
    motion = rr.read_motion(path)
    motion = motion.frames(0, min(len(motion), round(seconds * motion.fps) + 1))
    takes, figures = [], []
    for robot in robots:
        try:
            result = rr.retarget(motion, robot, balance="off")
        except RobotRetargetError as error:
            figures.append(f"<figure><figcaption>{html.escape(f'{robot.name}: {error}')}</figcaption></figure>")
            continue
        takes += view(result).takes
        figures.append(_figure(path.stem, result, target))
    page = f"{path.stem}.html"
    if takes:
        Viewer(tuple(takes)).save(target / page)
    title = html.escape(path.stem.replace("_", " "))
    return f'<section><h2>{title} · <a href="{page}#play">look at it</a></h2>{"".join(figures)}</section>'


def _figure(clip: str, result: rr.Result, target: Path) -> str:
    figure, name = result.match.figure(result.motion), result.robot.name
    drawn = strip(result.robot, result.trajectory, *figure, height=300)
    if not isinstance(drawn, Picture):
        return f"<figure><figcaption>{html.escape(f'{name}: {drawn.reason}')}</figcaption></figure>"
    picture = drawn.save(target / f"{clip}_{name}.png")
    return f'<figure><a href="{clip}.html#play"><img alt="{clip} on {html.escape(name)}" src="{picture.name}"></a><figcaption>{html.escape(name)}</figcaption></figure>'


if __name__ == "__main__":
    main()
