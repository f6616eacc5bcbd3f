"""Settings of an alignment, by stage; every number is checked."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from typing import Annotated, Any, get_args, get_origin, get_type_hints

import numpy as np

from slam.matching import MatchConfig
from slam.matching.match import register

METHODS: dict[str, str | Callable[..., Any]] = {
    "joint": "stitch.alignment.joint:align_joint",
    "htms": "stitch.published.htms:align_htms",
    "carpin": "stitch.published.carpin:align_carpin",
    "censi": "stitch.published.censi:align_censi",
    "akaze": "stitch.published.features:align_features",
    "orb": "stitch.published.features:align_features",
}
"""Every aligner by its name: a function ``(a, b, prior, config)``, or where one is to be found."""

Count = Annotated[int, "a whole number of at least 1", lambda x: isinstance(x, int) and x >= 1]
Amount = Annotated[float, "0 or a positive number", lambda x: 0.0 <= x < math.inf]
Positive = Annotated[float, "a positive number", lambda x: 0.0 < x < math.inf]
Share = Annotated[float, "a number from 0 to 1", lambda x: 0.0 <= x <= 1.0]
Limit = Annotated[float, "a number", lambda x: not math.isnan(x)]
"""Types of numbers: what `Checked` expects of them, in words and as a test."""

_hints: Any = cache(get_type_hints)


class Checked:
    """A configuration whose numbers are checked by their types: ``ValueError`` names the field and what was
    expected."""

    def __post_init__(self) -> None:
        for name, hint in _hints(type(self), include_extras=True).items():
            value = getattr(self, name)
            is_tuple = get_origin(hint) is tuple
            kind = get_args(hint)[0] if is_tuple else hint
            if get_origin(kind) is Annotated:
                expected, valid = kind.__metadata__
                if not all(map(valid, value if is_tuple else (value,))):
                    raise ValueError(f"{name}: expected {expected}, got {value!r}")


@dataclass(frozen=True)
class WallConfig(Checked):
    """What is a wall, and what may be furniture."""

    furniture_weight: Share = 0.1
    """Weight of a cell that may be furniture; one of a wall has 1."""
    furniture_length: tuple[Positive, Positive] = (1.2, 1.8)
    """Straight up to the first [m]: furniture; from the second on: a wall; between them the weight grows."""
    run_directions: Count = 16
    """Directions, over half a turn, in which a straight run is looked for."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.furniture_length[0] < self.furniture_length[1]:
            raise ValueError(f"furniture_length: expected two growing lengths, got {self.furniture_length}")


@dataclass(frozen=True)
class DirectionConfig(Checked):
    """When the walls of a map have directions, by its Hough spectrum; read by joint, carpin and censi."""

    min_crest: Amount = 1.5
    """Maximum over mean of a spectrum that must be exceeded; 1 without any structure."""
    min_variation: Amount = 0.1
    """Standard deviation over mean of a spectrum that must be exceeded; 0 without any structure."""
    separation: Positive = np.radians(10.0)
    """Peaks nearer to each other than this [rad] are one (htms too)."""
    min_strength: Share = 0.04
    """Least product of two spectra at a common direction, of its maximum; the ends of one wall have less."""
    min_background_ratio: Amount = 2.0
    """The same, of the product's median, which is what unrelated walls add to every direction."""


@dataclass(frozen=True)
class RotationConfig(Checked):
    """Which rotations joint tries."""

    n_theta: Count = 360
    """Directions of the Hough transform, over half a turn."""
    n_peaks: Count = 6
    """Most peaks of the spectra's correlation; each is tried with its twin half a turn away."""
    min_peaks: Count = 2
    """So many peaks are tried however low they are: right angles have two."""
    min_peak_ratio: Share = 0.9
    """Height of any further peak, as a share of the highest."""
    smoothing: Amount = np.radians(1.0)
    """Standard deviation [rad] of the blur of the correlation; 0: peaks are whole bins."""
    sweep_step: Positive = 0.035
    """Step [rad] of the sweep where walls have no directions."""
    sweep_limit: Amount = 0.35
    """Reach [rad] of the sweep around a prior at most."""


@dataclass(frozen=True)
class SearchConfig(Checked):
    """The search of all shifts of each rotation, done with two penalties; a score is in cells of wall.

    A coinciding cell of a straight wall scores 3.5 with a blur of 1.
    """

    resolution: Positive = 0.2
    """Side of a cell [m]."""
    free_penalty: Amount = 40.0
    """Lost per wall cell in the other's free space: finds small overlaps of maps that agree."""
    lenient_penalty: Amount = 12.0
    """The same for maps that are bent, or between which things were moved."""
    blur: Amount = 1.0
    """Standard deviation of the walls' blur in cells, here and in the climb."""
    facing_share: Share = 0.5
    """Share of the agreement that is times the cosine between the walls' normals, 0 where one is unknown; at
    0.5 walls that face opposite ways do not agree."""
    shifts_per_rotation: Count = 3
    """Best shifts that each rotation puts up."""
    separation: tuple[Positive, Positive] = (0.5, np.radians(5.0))
    """Alignments nearer to each other than this (m at b's walls, rad) are one."""
    candidates: Count = 8
    """Best alignments of each of the two searches that are climbed from."""


@dataclass(frozen=True)
class PriorConfig(Checked):
    """How a prior is used."""

    weight: Amount = 20.0
    """Cells of score lost per half of a squared Mahalanobis distance from the prior."""
    sigmas: Positive = 3.0
    """Half width of the search around the prior in standard deviations."""
    margin: tuple[Amount, Amount] = (0.5, np.radians(2.0))
    """Added to that (m, rad): the covariance says nothing about the grid's cells."""
    confidence: Share = 0.999
    """An answer outside the prior's χ² region of this probability is refused (not by htms); 1: none is."""


@dataclass(frozen=True)
class ClimbConfig(Checked):
    """The climb of the score between the cells: all candidates coarsely, the likeliest then finely."""

    coarse_step: tuple[Positive, Positive] = (0.1, np.radians(1.0))
    """First step (m, rad) of the coarse climb."""
    fine_step: tuple[Positive, Positive] = (0.025, np.radians(0.25))
    """First step (m, rad) of the fine climb."""
    halvings: Count = 1
    """Times that either step is halved."""
    max_steps: Count = 10
    """Steps of one length at most."""
    stride: Count = 3
    """The coarse climb reads one wall point in so many."""
    finalists: Count = 6
    """Candidates that climb on finely."""


@dataclass(frozen=True)
class RefinementConfig(Checked):
    """The scan matcher after the climb. Raises ``ValueError`` for an unknown one."""

    enabled: bool = True
    """False: the climb's answer stands."""
    method: str = "plicp"
    """A name of `slam.matching.match`."""
    points: Count = 1000
    """About how many of b's points are matched: more cost time and add nothing."""
    max_correction: tuple[Positive, Positive] = (0.3, 0.05)
    """A matcher that moves the answer further (m at the pivot, rad) has left the peak: refused."""
    matcher: MatchConfig = field(
        default_factory=lambda: MatchConfig(levels=((0.3, 1), (0.2, 1)), least_pairs=30, search_shift=0.0)
    )
    """The matcher's own settings."""

    def __post_init__(self) -> None:
        super().__post_init__()
        register(self.method)


@dataclass(frozen=True)
class CovarianceConfig(Checked):
    """The covariance of an answer, from the score around it."""

    temperature: Positive = 2.0
    """Difference of scores [cells] that is taken for noise."""
    step: tuple[Positive, Positive] = (0.05, np.radians(0.5))
    """Spacing (m, rad) of the 5 x 5 x 5 poses at which the score is read."""
    warp: tuple[Amount, Amount] = (0.018, 0.0026)
    """Distortion (m, rad) within a submap of about 30 x 20 m, as standard deviations."""


@dataclass(frozen=True)
class Acceptance(Checked):
    """What an alignment must show to be believed."""

    min_overlap: Amount = 4.0
    """Area [m²] known in both maps."""
    min_open: Amount = 3.0
    """Area [m²] free in both maps: two maps back to back along one wall share the wall only."""
    min_lead: Limit = 1.0
    """Log-odds of the overlap likelihood ahead of any other candidate."""
    max_ambiguity: Limit = 0.5
    """Log-odds of the best other candidate, as a share of the best's: the better of two that would both do
    may just share more with the other map."""
    equal_walls: Limit = 0.9
    """Share of the best's walls that another candidate must bring together to fit as well, which is refused;
    inf: none is. This and the next are from 160 drawn rooms, nearly square."""
    equal_conflict: Limit = 0.04
    """So much of its walls may be in free space beyond those of the best: false answers have 0.02, right ones
    0.06 or more."""
    equal_turn: Amount = np.radians(30.0)
    """Only candidates that are turned by more than this [rad] from the best are asked whether they fit as
    well."""
    min_belief: Limit = 0.0
    """Log-odds of being right, by `stitch.alignment.acceptance`."""
    slide: Positive = 0.4
    """Metres by which an alignment is moved in eight directions to see what of its agreement is lost."""
    sliding: Limit = 0.1
    """A positional distinctness below this is named as the reason of a low belief."""
    close_lead: Limit = 4.0
    """A lead below this is named as the reason of a low belief."""


@dataclass(frozen=True)
class TolerantConfig(Checked):
    """Maps that may be bent, tried where joint refuses; scores are in metres of wall."""

    enabled: bool = False
    """Whether it is tried: for whole maps of others, not for submaps of a drive, which are hardly bent."""
    free_scale: bool = False
    """Whether b's scale may differ by up to a fifth: maps that state a wrong resolution, floor plans. Joint
    is not asked then."""
    scale_step: Positive = 0.05
    """Step between the scales that are tried, as a share."""
    scale_rounds: Count = 3
    """Times that the best scale is refined."""
    max_scale: Positive = 0.2
    """By how much a free scale may differ from 1."""
    unknown_weight: Positive = 0.3
    """Weight of a metre of wall that faces nowhere: furniture, corners, clutter."""
    width: Positive = 0.7
    """How far walls that are the same may lie apart in the search [m], as a standard deviation."""
    conflict: Amount = 1.0
    """Metres lost in the search per metre of wall deep in the other's free space."""
    min_rotation: Share = 0.35
    """Rotations are tried at which the directions of the walls agree so well, as a share of the best."""
    peaks: Count = 6
    """Best shifts that each rotation puts up."""
    separation: tuple[Positive, Positive] = (1.0, np.radians(8.0))
    """Alignments nearer to each other than this (m at b's middle, rad) are one in the search."""
    candidates: Count = 60
    """Best alignments of the search that are bent."""
    settle_widths: tuple[Positive, Positive] = (0.8, 0.35)
    """First and last reach [m] of the rigid alignment of each candidate, as standard deviations."""
    settle_steps: Count = 8
    """Steps from the one to the other."""
    spacing: Positive = 4.0
    """Distance of the knots [m] of the lattice that bends."""
    spring: tuple[Positive, Positive] = (0.2, np.radians(2.5))
    """Standard deviation (m, rad) of a knot seen from one 4 m away."""
    stiffness: Positive = 0.05
    """Metres of wall that half a squared standard deviation of the springs costs."""
    bend_widths: tuple[Positive, Positive] = (1.5, 0.35)
    """First and last reach [m] of the bending, as standard deviations."""
    bend_steps: Count = 10
    """Steps from the one to the other."""
    judged_width: Positive = 0.35
    """How far walls that are the same may lie apart once bent [m], as a standard deviation."""
    judged_conflict: Amount = 1.25
    """Metres lost per metre of wall deep in the other's free space once bent."""
    rival: tuple[Positive, Positive] = (2.0, np.radians(15.0))
    """A candidate this far (m at b's middle, rad) from the best once bent is its rival."""
    min_margin: Limit = 35.0
    """Metres of score ahead of the best rival, times ``(2 share − 1)²``, share being that of the walls that
    agree of those that agree or contradict."""
    max_ambiguity: Limit = 0.6
    """Score of the best rival, as a share of the best's."""
    min_jacobian: Limit = 0.2
    """Least determinant of the Jacobian of a bend that is believed: there a fifth of the area is left."""
    belief_scale: Positive = 5.0
    """Metres of margin beyond the least that make one of log-odds."""
    alternatives: Count = 4
    """Rivals that are told at most."""
    piece: Positive = 4.0
    """Side [m] of the pieces of overlap whose deviations from the rigid part tell its covariance."""
    related_pieces: Positive = 4.0
    """So many neighbouring pieces deviate alike: bending is smooth."""
    piece_sigma: Positive = 0.05
    """Standard deviation [m] of a piece at least."""
    max_sigma: tuple[Positive, Positive] = (1.0, np.radians(10.0))
    """Standard deviation (m, rad) of the rigid part at most."""


@dataclass(frozen=True)
class CarpinConfig(Checked):
    """Carpin (2008)."""

    n_theta: Count = 360
    """Directions of the Hough transform, over half a turn."""
    n_peaks: Count = 4
    """Rotations that are tried, each with its twin half a turn away."""
    min_acceptance_index: Share = 0.94
    """Below this ω there is no answer. Carpin's own threshold we could not read; this is from 300 pairs of
    drawn floor plans with 3 cm of noise (seeds 100–329): 19 of 20 true answers have 0.948 or more, 49 of 50
    false ones 0.937 or less."""


@dataclass(frozen=True)
class CensiConfig(Checked):
    """Censi et al. (2005); all but the last are the authors' program's own."""

    n_theta: Count = 360
    """Directions of the Hough transform, over half a turn."""
    n_peaks: Count = 4
    """Rotations that are tried, each with its twin half a turn away."""
    smoothing: Amount = np.radians(1.0)
    """Standard deviation [rad] of the blur of the spectra's correlation."""
    directions: Count = 3
    """Projections per rotation."""
    lags: Count = 5
    """Lags of each projection that are combined."""
    max_residual: Amount = 3.0
    """Cells by which a lag may miss the solution: one is rounding, the rest bent walls."""


@dataclass(frozen=True)
class FeatureConfig(Checked):
    """OpenCV's features (akaze, orb); a pixel is a cell."""

    margin: Count = 32
    """Unknown pixels around a map: detectors leave out what is near the border."""
    orb_features: Count = 1500
    """Features that ORB keeps at most."""
    ratio: Share = 0.7
    """Most distance to the nearest descriptor over that to the second, from OpenCV's stitching."""
    max_matches: Count = 500
    """Matches kept, the most alike."""
    proposers: Count = 150
    """Matches, the most alike, whose pairs propose transforms; all vote (as in Chum & Matas 2005)."""
    reach: Positive = 3.0
    """Pixels from its partner within which a match agrees with a transform: OpenCV's default."""
    min_arm: Amount = 10.0
    """Pixels between two matches that propose a transform: 3 pixels of error are 17° then."""
    min_confidence: Amount = 0.5
    """Of ``agreeing / (8 + 0.3 matches)`` (Brown & Lowe 2007). multirobot_map_merge asks for 1, which refuses
    most true answers at half overlap; on 300 pairs of drawn floor plans (seeds 100–329) 19 of 20 false
    answers have less than 0.46."""


@dataclass(frozen=True)
class AlignConfig(Checked):
    """How two submaps are aligned. Raises ``ValueError`` for an unknown method or a number without sense."""

    method: str = "joint"
    """A name of `METHODS`: ours ("joint") or one of `stitch.published`."""
    resolution: Positive = 0.1
    """Side of the cells [m] that walls are compared in; read by every method."""
    walls: WallConfig = field(default_factory=WallConfig)
    """Of joint."""
    directions: DirectionConfig = field(default_factory=DirectionConfig)
    """Of all methods that use the Hough spectrum."""
    rotation: RotationConfig = field(default_factory=RotationConfig)
    """Of joint."""
    search: SearchConfig = field(default_factory=SearchConfig)
    """Of joint."""
    prior: PriorConfig = field(default_factory=PriorConfig)
    """Of joint, but for the confidence, which all methods but htms read."""
    climb: ClimbConfig = field(default_factory=ClimbConfig)
    """Of joint."""
    refinement: RefinementConfig = field(default_factory=RefinementConfig)
    """Of joint."""
    covariance: CovarianceConfig = field(default_factory=CovarianceConfig)
    """Of joint."""
    acceptance: Acceptance = field(default_factory=Acceptance)
    """Of joint."""
    tolerant: TolerantConfig = field(default_factory=TolerantConfig)
    """Of joint."""
    carpin: CarpinConfig = field(default_factory=CarpinConfig)
    """Of carpin."""
    censi: CensiConfig = field(default_factory=CensiConfig)
    """Of censi."""
    features: FeatureConfig = field(default_factory=FeatureConfig)
    """Of akaze and orb. What htms does is fixed by the thesis."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.method not in METHODS:
            raise ValueError(f"method: expected one of {', '.join(METHODS)}, got {self.method!r}")
