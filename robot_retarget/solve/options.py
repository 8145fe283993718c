"""How long and how carefully to search."""

from dataclasses import dataclass, field

from robot_retarget.solve.windows import Windows


@dataclass(frozen=True)
class Options:
    """Of the sequential quadratic program of one frame. Lengths are shares of a leg."""

    iterations: int = 16
    """Steps at most, per frame; twice as many from a start that is no neighbour."""
    tolerance: float = 2e-5
    """Stop when no step would lower the cost by more than this share of it [-]."""
    trust_region: float = 0.5
    """Largest step of one hinge in one iteration [rad]; the root's may be twice as large [rad, m]."""
    growth: float = 3.0
    """How much the trust region may grow after a step that was accepted [-]."""
    damping: float = 1e-3
    """Levenberg's λ at the outset."""
    refusals: int = 6
    """Steps that raised the cost, after which a descent gives up; each one taken makes up for one of them."""
    reach: float = 0.05
    """Links nearer than this have rows in the quadratic program."""
    glance: float = 0.02
    """Distances of links are extrapolated along their slopes until a joint turns by more [rad]."""
    tolerated: float = 2e-4
    """Deficit of the margin that costs nothing: distances bend along a step."""
    overlap_cost: float = 1e6
    """Cost of the squared deficit beyond that, over the squared leg."""
    overlap: float = 5e-4
    """Links inside each other by more are not accepted [m]."""
    sunk: float = 1e-4
    """A start that violates an inequality by more takes its first steps at any cost [m]."""


@dataclass(frozen=True)
class Search:
    """Of candidate poses over a clip, among which a path is chosen by dynamic programming."""

    rate: float = 10.0
    """Moments per second [1/s]."""
    every: float = 1.0
    """Time between the moments at which candidates are sought [s]."""
    starts: int = 3
    """Starts with limbs drawn within their ranges, beside the reference and the standing pose."""
    drawn: int = 80
    """Poses drawn per limb for these."""
    iterations: int = 10
    """Steps at most to follow a candidate to the next moment."""
    tolerance: float = 1e-3
    """As `Options.tolerance`: a path is chosen long before poses are exact."""
    candidates: int = 3
    """Kept per moment at which they are sought ..."""
    worth: float = 1.3
    """... if they cost less than so many times the least [-]."""
    same: float = 0.15
    """Poses whose hinges all lie nearer than this are one [rad]."""
    change: float = 0.5
    """Cost of a change of pose between moments [1/rad²] ..."""
    beyond_speed: float = 30.0
    """... and of what hinges turn beyond their speeds on top [1/rad²]."""
    recombinations: int = 2
    """Rounds at most in which limbs are exchanged between the path and cheaper candidates."""
    excess: float = 0.05
    """A path is looked at where it costs by this share more than the cheapest candidate of the moment [-]."""


@dataclass(frozen=True)
class RealTime:
    """Of a stream: one frame after the other, as they come."""

    steps: float = 60.0
    """Of the quadratic program, per second; one a frame at least [1/s]."""
    frequency: float = 3.3
    """What π = 1/rad² pulls follows like a mass on a spring of this natural frequency [1/s] ..."""
    damping: float = 0.5
    """... and this damping ratio [-]; stronger edges are followed the more closely."""
    root_speed: float = 6.0
    """The root moves at most so fast [m/s] ..."""
    root_turn: float = 25.0
    """... and turns at most so fast [rad/s]."""
    gap: float = 0.1
    """After a longer time without a frame [s] ..."""
    ease: float = 0.5
    """... joints gather their speed anew within this one [s]."""
    start: int = 32
    """Steps at most to the first pose, from the standing one."""
    looks: float = 30.0
    """Steps per second that another pose takes from the standing one on [1/s] ..."""
    home_steps: int = 16
    """... until it has taken so many and is compared."""
    same: float = 1.0
    """Poses whose hinges all lie nearer than this are in one basin: one lags behind the other [rad]."""
    worth: float = 0.8
    """It is gone over to what costs less than this share [-] ..."""
    unhurried: float = 0.4
    """... with this share of the joints' speeds on the mean [-]."""


@dataclass(frozen=True)
class Smoothing:
    """Of a whole clip: the alternating direction method of multipliers between frames and a smooth path."""

    passes: int = 8
    """How often every frame takes a step; 0 solves frame by frame."""
    proximal: float = 40.0
    """ρ, how strongly a frame is drawn to the smooth path [1/rad²]."""
    tolerance: float = 1e-5
    """A pass leaves a frame alone that it could better by a smaller share of its cost [-]."""
    looks: tuple[int, ...] = (2, 4, 6)
    """Before these passes links are looked for that pass through each other between frames."""
    extra: int = 16
    """More passes at most, over the frames that have not converged."""
    converged: float = 0.01
    """A frame has converged if the last pass moved it by less [rad or m] ..."""
    settled: float = 0.01
    """... or lowered its cost by a smaller share [-]."""
    windows: Windows = field(default_factory=Windows)
    """How a long clip is cut."""
