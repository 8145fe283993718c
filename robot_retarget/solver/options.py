"""Options that set the effort and the accuracy of the search, and the windows of a long clip."""

from collections.abc import Iterator
from dataclasses import dataclass, field

# A long clip is solved in windows of bounded memory that join without a seam.
# Each window keeps the last frames of the window before unchanged. Those frames were solved with more foresight than the
# range of the smooth path, so the frames after them fit as if both windows had been solved together.


@dataclass(frozen=True)
class Windows:
    """The lengths of the windows of a clip."""

    length: float = 20.0
    """Length of a window [s]; a clip that is little longer stays whole. It holds 600 frames at 30 a second, of 0.1 MB each."""
    kept: float = 1.0
    """Part of the window before that is fixed at the start of the next [s]."""
    foreseen: float = 1.0
    """End of a window that the next window solves again; it lets the frames before it prepare for what follows [s]."""

    def cut(self, frames: int, fps: float) -> Iterator["FrameWindow"]:
        """Yield windows that cover every frame once."""
        kept, foreseen = (max(1, round(seconds * fps)) for seconds in (self.kept, self.foreseen))
        length = max(round(self.length * fps), kept + foreseen + 1)  # every window adds a frame at least
        first, done = 0, 0
        while done < frames:
            last = first + length
            if last + kept + foreseen >= frames:
                last = frames
            final = last if last == frames else last - foreseen
            yield FrameWindow(first, last, done - first, final)
            first, done = final - kept, final


@dataclass(frozen=True)
class FrameWindow:
    """Frames `first` … `last` − 1; the first `fixed` are known, and those before `final` are kept."""

    first: int
    last: int
    fixed: int
    final: int


@dataclass(frozen=True)
class SolveOptions:
    """Options of the sequential quadratic program of one frame. Lengths are shares of a leg.

    In brackets: the cost of 2 s of a dance on the G1 with half and with double, measured with the passes that solved clips up to 0.3.0; 76.34
    with these options.
    """

    iterations: int = 16
    """Maximum number of steps per frame; twice as many from a start that is no neighbour (76.34, 76.34)."""
    tolerance: float = 2e-5
    """Stop when the best step lowers the cost by no more than this share of it [-] (76.34, 76.34)."""
    trust_region: float = 0.5
    """Largest step of one hinge in one iteration [rad]; twice this for the root [rad, m] (75.76, 75.71; its jerk, 245
    rad/s³, 244 and 244)."""
    growth: float = 3.0
    """Growth factor of the trust region after an accepted step [-]. Half and double change the cost of a clap and a kick by
    -4.2 and -0.3 % on the OP3, whose kick ends in other poses, and by nothing on the G1."""
    damping: float = 1e-3
    """Initial value of Levenberg's λ (76.34, 76.34)."""
    refusals: int = 6
    """Number of refused steps after which a descent stops; each accepted step cancels one of them."""
    reach: float = 0.05
    """Links nearer than this have rows in the quadratic program; with .03, hands that meet end in dearer poses. Half and
    double change the costs of a clap and a kick by less than 0.05 %."""
    distance_cache_radius: float = 0.02
    """Distances of links are extrapolated along their slopes until a joint turns by more [rad] (76.34, 76.34)."""
    touching_cache_radius: float = 0.001
    """... and where links lack their margin, until one turns by more [rad]: edges of hulls turn normals at once. With .02, a dance
    whose hands rest on the trunk ends at twice the cost; with .00001 it costs the same."""
    tolerated: float = 2e-4
    """Deficit of the margin without a cost: distances bend along a step. Half and double change the cost of a clap and a kick
    by nothing on the G1, by -0.1 and -0.7 % on the OP3."""
    overlap_cost: float = 1e6
    """Cost of the squared deficit beyond that, over the squared leg. Half and double change the cost of a clap and a kick by
    0.1 and -0.2 % on the OP3 and by nothing on the G1."""
    overlap: float = 5e-4
    """Deeper interpenetration of links is not accepted [m] (76.34, 76.34)."""
    floor_tolerance: float = 1e-4
    """A start that violates an inequality by more takes its first steps at any cost [m] (76.34, 76.34)."""
    threads: int = 1
    """Threads that share the frames of a clip; the result does not depend on their number."""


@dataclass(frozen=True)
class Search:
    """Options of the search for candidate poses over a clip; dynamic programming chooses a path among them.

    In brackets: the cost of 2 s of a dance on the G1 with half and with double, measured with the passes that solved clips up to 0.3.0; 76.34
    with these options.
    """

    rate: float = 10.0
    """Moments per second [1/s] (74.94, 75.94; mean angle of the limbs, 3.69°, 3.81 and 3.69)."""
    every: float = 0.3
    """Time between the moments at which a descent begins in the reference pose [s] (76.75, 76.88) ..."""
    reached: int = 12
    """... and maximum number of its steps (76.34, 76.34)."""
    dear: float = 0.2
    """Share of these moments that have several starts [-]: those of highest cost, and always the first and the last. With .06
    the arms of the OP3 stayed in a basin of up to 1.3 times the cost; with 1 the cost of clips did not change."""
    starts: int = 8
    """Number of starts with limbs drawn within their ranges, in addition to the reference and the standing pose (76.32,
    76.34)."""
    rough: int = 4
    """Maximum number of steps of every start (76.32, 76.32) ..."""
    finished: int = 4
    """... and number of the cheapest ends that continue (76.34, 76.32)."""
    drawn: int = 80
    """Number of poses drawn per limb for these starts (76.34, 76.32)."""
    apart: float = 1.0
    """Draws of a limb with all hinges nearer than this mostly end in one basin: starts take draws further apart first [rad]."""
    iterations: int = 6
    """Maximum number of steps to follow a candidate to the next moment (77.02, 76.05)."""
    tolerance: float = 2e-3
    """As `SolveOptions.tolerance`: a path is chosen before poses are exact."""
    same: float = 0.15
    """Two poses count as the same if all their hinges lie nearer than this [rad]. Half and double change the costs of a clap
    and a kick on the G1 and the OP3 by less than 0.1 %."""
    held: float = 0.03
    """Weight that draws a pose to that of the moment before when it is followed [1/rad²]. With 0 a samba costs 1.017 of it on
    the G1, and a ballet 0.92 on the OP3."""
    change: float = 0.5
    """Cost of a change of pose between moments [1/rad²]; half and double lower the cost of a kick on the OP3 by 1 and 2 % and
    change nothing on the G1 ..."""
    beyond_speed: float = 30.0
    """... and additional cost of the hinge angles beyond their speeds [1/rad²]; half and double change nothing in a clap and
    a kick on both ..."""
    through: float = 2000.0
    """... and of the depth of links that pass through each other, over the squared leg [-]. Half and double change nothing in
    a clap and a kick on both."""


@dataclass(frozen=True)
class RealTime:
    """Options of a stream: one frame after the other, as frames arrive."""

    steps: float = 60.0
    """Steps of the quadratic program per second; at least one per frame [1/s]: the limbs of a walk on the OP3 are off
    by 7.19° with half, 6.94° with double and 7.01° with it."""
    frequency: float = 3.3
    """An edge of π = 1/rad² is followed like a mass on a spring of this natural frequency [1/s] ..."""
    damping: float = 0.5
    """... and this damping ratio [-]; a stronger edge is followed more closely. In streams of a clap and a kick on the G1 the
    jerk is 1690 with half, 1060 with double and 1320 rad/s³ with it."""
    root_speed: float = 6.0
    """Largest speed of the root [m/s] (half and double change no stream of a clap and a kick) ..."""
    root_turn: float = 25.0
    """... and its largest angular speed [rad/s]; half and double change none of those streams."""
    drawn: float = 30.0
    """Weight that draws the newest frame of a lag to its pose without the lag, because no later frame bounds its motion
    [1/rad²]. Three dances and walks on the G1, one frame late: limbs off by 5.2° with 10, 4.9° with 1e5; three frames late: jerk
    1.20 and 1.30 times the whole clip's."""
    gap: float = 0.1
    """After a longer time without a frame, of 3 frames at 30 a second [s] ..."""
    ease: float = 0.5
    """... the joints regain their full speed within this time [s]; half and double do not change a stream without
    pauses."""
    start: int = 2 * SolveOptions.iterations
    """Steps at most to the first pose, from the standing one, which is no neighbour."""
    home_rate: float = 30.0
    """Steps per second that another pose takes from the standing one on [1/s] (half lowers the limb error of those streams by
    0.2°, double changes nothing) ..."""
    home_steps: int = SolveOptions.iterations
    """... and number of these steps before the two are compared."""
    same: float = Search.apart
    """Poses with all hinges nearer than this are in one basin: one lags behind the other [rad]."""
    worth: float = 0.8
    """The robot moves to the second pose if it costs less than this share [-] (half and double change no stream of a clap and
    a kick on the G1 and the OP3) ..."""
    unhurried: float = 0.4
    """... with this share of the joints' speeds on average [-]: the mean limb error of those streams is 14.0° with half,
    12.0° with double and 12.5° with it, the jerk 1050, 1690 and 1320 rad/s³."""


@dataclass(frozen=True)
class Smoothing:
    """Options of a whole clip: Gauss–Newton steps over all frames."""

    steps: int = 30
    """Maximum number of steps between two changes of the targets; measured: most clips need four to twelve."""
    rounds: tuple[int, ...] = (3, 2, 5)
    """Numbers of steps after which the footholds move to the path. After one or two they are still far from where the legs
    put the feet. After the last, feet that miss their footholds are free: with 2 for 5, a kick of the OP3 costs 4 % more with 12
    held corners fewer; at the minimum, its unreachable feet keep it from other basins (8 % more)."""
    gain: float = 3e-5
    """The steps end where the next one would gain less than this share of the cost of a median frame, per frame [-]. A hand of the
    OP3 that an edge moves in frames 30 to 50 changes the other arm 16 frames away by 0.069 rad with 1e-4, by 0.015 with 3e-5 and by
    0.014 with 1e-5; the wave takes 27, 38 and 46 factorisations a frame."""
    tries: int = 3
    """Number of times that a step that would raise the cost is shortened [-]: with 1, four claps on the OP3 cost 0.1 % more, with 6 the
    same."""
    converged: float = 0.01
    """A frame has converged if the last step moved it by less [rad or m]; measured: a hundredth of a radian cannot be seen."""
    windows: Windows = field(default_factory=Windows)
    """The windows of a long clip."""
