"""The experiments with the interaction distance; `reproduce_papers.py` runs them with the others."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import paper_plots as draw
from interacting_positions import interacting_positions
from paper_instances import smoothness_edges
from paper_scenes import meeting, reaching

import robot_retarget as rr
from robot_retarget.base.files import SAMPLES
from robot_retarget.papers import (
    Interaction,
    Ipopt,
    Objective,
    SkeletalStructure,
    Spectral,
    adapt,
    interaction_distance,
    pair_edges,
    solve,
    solve_causally,
    stress,
)
from robot_retarget.papers.edges import INTERACTION

Row = tuple[str, str, str]


def anticipation(out: Path) -> list[Row]:
    """Interaction paper, Fig. 2: a wrist approaches the opposite shoulder."""
    x, own = reaching()
    d, alpha = interaction_distance(x[:-1], x[1:])
    euclid = np.linalg.norm(x[1:, 0] - x[1:, 1], axis=1)
    frames = np.arange(2, len(x) + 1)
    late, early = int(np.argmax(euclid < 0.1)), int(np.argmax(d[:, 0] < 0.1))
    sheet, axes = draw.sheet(2, 1, (4.2, 3.2))
    for frame, shade in zip((15, 42, early + 1, 99), draw.shades(4), strict=True):
        draw.limb(axes[0, 0], own, x[frame, 0], shade)
        axes[0, 0].plot(*x[frame, 0], "o", color=draw.RED, ms=6, alpha=0.4 + 0.6 * (frame == 99))
    ahead = x[early, 0] + np.arange(1, alpha[early, 0] + 5)[:, None] * (x[early + 1, 0] - x[early, 0])
    axes[0, 0].plot(*ahead.T, ".", color=draw.RED, ms=3, alpha=0.6)
    axes[0, 0].plot(*np.stack([ahead[alpha[early, 0] - 1], x[0, 1]]).T, color=draw.BLUE, lw=1.5)
    draw.dot(axes[0, 0], x[0, 1], draw.BLUE, 9)
    draw.dot(axes[0, 0], own, draw.INK, 8)
    draw.bare(axes[0, 0], f"the wrist's steps ahead at frame {frames[early]}")
    axes[0, 1].plot(frames, euclid, color=draw.INK, label="Euclidean")
    axes[0, 1].plot(frames, d[:, 0], color=draw.BLUE, label="interaction")
    axes[0, 1].axhline(0.1, color=draw.GREY, ls=":", lw=1)
    for place, color in ((late, draw.INK), (early, draw.BLUE)):
        axes[0, 1].axvline(frames[place], color=color, lw=0.8, ls="--")
    axes[0, 1].set(xlabel="frame", ylabel="distance [m]", title=f"{late - early} frames ahead at 0.10 m")
    axes[0, 1].legend(frameon=False)
    draw.save(sheet, out / "mucherino-2019-fig2.png")
    got = (
        f"threshold 0.10 m: Euclidean at frame {frames[late]}, interaction at {frames[early]}, {late - early} frames ahead, "
        f"α = {alpha[early, 0]} there; least D {d.min():.3f} < final distance {euclid[-1]:.3f}"
    )
    says = "anticipates the contact by several frames; D at one frame is below the last Euclidean distance"
    return [("Interaction Fig. 2", says, got)]


def two_constraints(out: Path) -> list[Row]:
    """Interaction paper, Fig. 3: where v may go when two interaction distances are prescribed."""
    before, now = np.array([[1.2, 2.7], [3.6, -2.1]]), np.array([[1.5, 1.75], [3.0, -1.0]])
    origin, wanted = np.zeros(2), np.array([0.55, 0.6])
    equal, alphas = interacting_positions(before, now, origin, wanted, horizon=6, equal=True)
    every, all_alphas = interacting_positions(before, now, origin, wanted, horizon=6)
    sheet, axes = draw.sheet(1, 1, (5.6, 5.0))
    axis = axes[0, 0]
    for a in range(1, 5):
        for joint, color in enumerate((draw.RED, draw.BLUE)):
            centre = before[joint] + a * (now[joint] - before[joint])
            draw.ring(axis, centre, wanted[joint], color, str(a), strong=a == 2)
    for joint, (color, name) in enumerate(((draw.RED, "u"), (draw.BLUE, "w"))):
        line = before[joint] + np.array([[0.0], [4.6]]) * (now[joint] - before[joint])
        axis.plot(*line.T, color=color, lw=0.6)
        axis.text(*before[joint], f"  p_{name}, frame t − 1", color=color)
    for point in equal:
        axis.plot(*np.stack([origin, 2.6 * point]).T, color=draw.INK, lw=1)
        axis.plot(*(2 * point), "o", mfc="white", mec=draw.INK, ms=5, zorder=4)
    for points, color, word in (
        (equal, draw.INK, "p_v at frame t, both α = 2"),
        (every[all_alphas[:, 0] != all_alphas[:, 1]], draw.GREY, "p_v with α_u ≠ α_w"),
    ):
        draw.dot(axis, points.T, color, 7, word)
    axis.text(*origin, "p_v, frame t − 1   ", ha="right", va="center")
    draw.dot(axis, origin, draw.INK, 4)
    axis.legend(frameon=False, loc="lower left")
    draw.bare(axis, "α beside the centres")
    draw.save(sheet, out / "mucherino-2019-fig3.png")
    got = f"{len(equal)} lines with equal α = {int(alphas[0, 0])}; {len(every)} solutions over all (α_u, α_w)"
    return [("Interaction Fig. 3", "two feasible lines, both with α = 2", got)]


def online(out: Path) -> list[Row]:
    """Future work of the interaction paper: the dynDGP with D, the future unknown."""
    scene = meeting()
    sheet, axes = draw.sheet(3, 1, (3.1, 3.0))
    found = {}
    for horizon in (0, 5, 10, 20):
        base = replace(scene.traces(False), interaction=Interaction(horizon))
        wishes = pair_edges(base, [("a", "b")], 0.1, kind=INTERACTION, priority=100.0)
        graph = base.joined(wishes, smoothness_edges(scene.names, scene.animation))
        found[horizon] = solve_causally(graph, scene.animation, Ipopt(()), Objective.HALF_SQUARED).positions
    for axis, horizon, title in ((axes[0, 0], 0, "Euclidean"), (axes[0, 1], 20, "interaction, horizon 20")):
        draw.tracks(axis, found[horizon], [0, 1], 16)
        draw.bare(axis, title, (-0.06, 1.06, -0.06, 1.06))
    reaction, force = {}, {}
    for horizon, color in zip(found, draw.shades(4), strict=True):
        aside = np.abs(found[horizon][:, 0, 1] - scene.animation[:, 0, 1])
        axes[0, 2].plot(
            np.arange(1, len(aside) + 1),
            aside,
            color=color,
            label="Euclidean" if horizon == 0 else f"horizon {horizon}",
        )
        reaction[horizon] = int(np.argmax(aside > 0.002))
        force[horizon] = np.linalg.norm(np.diff(found[horizon], 2, axis=0), axis=-1).max()
    axes[0, 2].set(xlabel="frame", title="way aside [m]", xlim=(0, 32), ylim=(0, 0.12))
    axes[0, 2].legend(frameon=False)
    draw.save(sheet, out / "dyndgp-interaction.png")
    got = "; ".join(
        f"horizon {horizon}: reacts at frame {reaction[horizon] + 1}, {reaction[0] - reaction[horizon]} ahead of Euclidean, "
        f"greatest second difference {force[horizon]:.4f} (Euclidean {force[0]:.4f})"
        for horizon in (5, 10, 20)
    )
    return [("dynDGP with D, frame by frame", "future work", got)]


def clap_of_table_joints(fps: float = 15.0, frames: int = 60) -> tuple[np.ndarray, SkeletalStructure]:
    """The sample clap without end sites, (T, 22, 3) [m], and its body."""
    motion = rr.read_motion(SAMPLES / "clap.bvh").resample(fps).frames(0, frames)
    skeleton = motion.skeleton
    kept = [k for k, name in enumerate(skeleton.names) if not name.endswith("_end")]
    parents = [kept.index(parent) if parent >= 0 else -1 for parent in skeleton.parents[kept].tolist()]
    body = SkeletalStructure(tuple(skeleton.names[k] for k in kept), np.array(parents), skeleton.offsets[kept])
    return motion.positions[:, kept], body


def longer_arms(body: SkeletalStructure) -> SkeletalStructure:
    """Upper arms and forearms 20 % longer."""
    return body.scaled([1.2 if name.endswith(("Elbow", "Wrist")) else 1.0 for name in body.names])


def clap(out: Path) -> list[Row]:
    """Future work of the interaction paper: the dynDGP with D of a whole body, a clap with arms 20 % longer."""
    x, body = clap_of_table_joints()
    target, ahead = longer_arms(body), Interaction(8, dead_band=1e-4)
    plain, moving = adapt(x, body, target), adapt(x, body, target, interaction=ahead)
    euclid = solve(plain, x, Ipopt(()))
    wrists = [body.names.index(f"{side}Wrist") for side in ("Left", "Right")]
    starts = {"from the source": x, "from Euclid's solution": euclid.positions}
    found = {name: solve(moving, start, Spectral(max_iterations=4000)) for name, start in starts.items()}
    sheet, axes = draw.sheet(2, 1, (4.2, 2.8))
    for (name, solution), color in zip(found.items(), (draw.RED, draw.BLUE), strict=True):
        axes[0, 0].semilogy(solution.history, color=color, label=name)
    axes[0, 0].axhline(stress(moving, euclid.positions), color=draw.GREY, ls=":", label="Euclid's solution")
    axes[0, 0].set(xlabel="iteration", title="σ with D, 22 joints × 60 frames [m²]")
    shown = {"source": (x, draw.GREY), "Euclid": (euclid.positions, draw.INK)}
    solved = found["from Euclid's solution"]
    shown["D"] = solved.positions, draw.BLUE
    for name, (places, color) in shown.items():
        apart = np.linalg.norm(places[:, wrists[0]] - places[:, wrists[1]], axis=1)
        axes[0, 1].plot(apart[20:45], color=color, label=name)
    axes[0, 1].set(xlabel="frame", title="distance of the wrists [m]")
    for axis in axes[0]:
        axis.legend(frameon=False)
    draw.save(sheet, out / "dyndgp-clap.png")
    got = (
        f"σ_D {stress(moving, euclid.positions):.3f} at Euclid's solution (σ {euclid.stress:.3f}, its own distances); descending from there "
        f"{solved.stress:.3f}, from the source {found['from the source'].stress:.3f}; "
        f"Euclidean σ of the former {stress(plain, shown['D'][0]):.3f}; {solved.seconds:.1f} s"
    )
    return [("dynDGP with D, a clap with arms +20 %", "future work", got)]
