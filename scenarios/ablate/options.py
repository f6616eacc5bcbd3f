"""What each study can be told on the command line; the first line of its options says what it answers."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import arg

from scenarios.options import StudyOptions

Folder = Annotated[Path, arg(aliases=["-o"])]
Format = Literal["table", "json"]


@dataclass(frozen=True)
class BeliefOptions(StudyOptions):
    """How far an alignment may be believed, learnt from pairs whose truth is known.

    Learn the network of `stitch.alignment.acceptance` from simulated pairs of submaps. The likeliest
    alignment of every pair, with a prior and without one, is an example, right or wrong within the limits of
    the stitching study; pairs of two buildings are examples that are always wrong. Furniture is moved in
    every building, in two of three besides the pairs in which it is not. What the network would accept is
    printed by bin, from networks that learnt from other seeds only. Needs the extra [train].
    """

    scenarios: str = "hospital,beehive,office_smoke,two_drives,twin_rooms"
    """Scenarios of the catalogue, with commas between."""
    seeds: str = "200-263"
    """Seeds: first-last, or numbers with commas between; 100 and above, two or more."""
    out: Folder = Path("runs/ablate-belief")
    """A folder for sweep.sqlite, from which a sweep that was interrupted goes on."""
    network: Path = Path("belief.npz")
    """The file to write; the package reads the one in its folder stitch."""


@dataclass(frozen=True)
class BendsOptions:
    """How well a known bend of a map is found, and how often bent maps are joined rightly or wrongly.

    Bend the second map of pairs of simulated submaps by smooth fields that are known, and join them as
    `python -m stitch` does. Told: whether the best candidate is the true place (its rigid part misses the
    shared walls by less than 1 m on the mean), how many are accepted, how many of these are wrong, and by how
    much rigid and bent walls miss their true places. Maps of different buildings must be refused.
    """

    scenarios: str = "hospital,beehive,office_smoke,two_drives"
    """Scenarios of the catalogue, with commas between."""
    seeds: str = "0-3"
    """Seeds: first-last, or numbers with commas between."""
    amplitudes: tuple[float, ...] = (0.0, 0.3, 0.6)
    """Largest displacements on either axis [m]."""
    format: Format = "table"
    """What is printed on stdout."""


@dataclass(frozen=True)
class ConfidenceOptions(StudyOptions):
    """What the confidence measures need to be told: weights of their combination, and thresholds.

    Learn `slam.odometry.combination` and the thresholds of `slam.odometry.segmentation` from simulated
    drives, and print them. Scenarios and seeds are others than those of the segmentation study; every
    scenario weighs alike. Needs the extra [train].
    """

    scenarios: str = "beehive,corridor,twin_rooms,two_drives"
    """Scenarios of the catalogue, with commas between."""
    seeds: str = "100-111"
    """Seeds: first-last, or numbers with commas between; 100 and above."""
    out: Folder = Path("runs/ablate-confidence")
    """A folder for sweep.sqlite, from which a sweep that was interrupted goes on."""


@dataclass(frozen=True)
class HalmstadOptions:
    """Real maps: annotated pairs of two buildings in Halmstad, and the two pieces of Experiment 3.

    Align real maps of one building with each other. Halmstad's maps were drawn by a hand-held device and are
    bent; keypoints were annotated by hand. All annotated pairs are scored by the mean error of the keypoints
    of the best candidate, accepted or not, rigid and bent (a pixel taken as 5 cm); accepted ones are wrong
    from 2 m on, told by the mean and by the median of the keypoints, as one map's annotations are broken.
    Pairs whose annotations a similarity fits within 2 m are told apart. Experiment 3 has no truth: what is
    reported is the share of the second piece's walls within 3 pixels of the first's.
    """

    data: Path = Path("../shared/data")
    """The folder with halmstad/ and maps/exp3/."""
    methods: str = "joint,akaze,orb"
    """Methods by name, with commas between; kiss as well where KISS-Matcher is installed."""
    scale: bool = False
    """Also lay every map onto the floor plan of its building, whose scale differs by up to a fifth."""
    format: Format = "table"
    """What is printed on stdout."""
    out: Annotated[Path | None, arg(aliases=["-o"])] = None
    """A folder for exp3.png: the answers on Experiment 3 beside Formsma's own map."""


@dataclass(frozen=True)
class RosMapsOptions:
    """ROS maps as people published them: each with itself, pairs of one place, pairs of different places.

    Join the maps of ros_maps/ with each other, read only; nothing is tuned on them. A map with itself must be
    the identity or refused; pairs of one place are joined with and without a prior (1 m and 10°, its error
    drawn); pairs of different places must be refused.
    """

    data: Path = Path("../shared/data")
    """The folder with ros_maps/."""
    places: str = ""
    """Folders of ros_maps/, with commas between; empty: all."""
    format: Format = "table"
    """What is printed on stdout; in JSON every pair, also of different places."""


@dataclass(frozen=True)
class LikenessOptions(StudyOptions):
    """What each meeting of two walls says of an alignment, learnt from pairs whose truth is known.

    Learn the weights of `stitch.alignment.likelihood` from simulated pairs of submaps, and print them. Every
    candidate of the search of a pair is an example, right or wrong within the limits of the stitching study.
    Furniture is moved in every building, in two of three besides the pairs in which it is not. Logistic
    regression on the square roots of the counts, with an L2 penalty; then the constant that a prior adds.
    Needs the extra [train].
    """

    scenarios: str = "hospital,beehive,office_smoke,two_drives"
    """Scenarios of the catalogue, with commas between; twin_rooms would teach the wrong thing."""
    seeds: str = "200-211"
    """Seeds: first-last, or numbers with commas between; 100 and above."""
    out: Folder = Path("runs/ablate-likeness")
    """A folder for sweep.sqlite, from which a sweep that was interrupted goes on."""


@dataclass(frozen=True)
class MethodsOptions(StudyOptions):
    """How good the map of a whole drive becomes, by scenario and method, on the same drives.

    Simulate every scenario with every seed, let every method map each drive, and compare them. A drive that
    makes a method fail is left out of its figures and counted; the exit code is then 1.
    """

    scenarios: str = "hospital,office_smoke,two_drives,collapsed,outdoor,twin_rooms"
    """Scenarios of the catalogue, with commas between."""
    seeds: str = "10"
    """Seeds: how many, counted from 0; or first-last; or numbers with commas between."""
    out: Folder = Path("runs/ablate-methods")
    """A folder for results.csv and sweep.sqlite, from which a sweep that was interrupted goes on."""
    methods: str = "ins,wsm,slamstitch,oracle"
    """Methods by name, with commas between; "oracle" is ours, told the true cuts and loop closures."""
    variant: str = "gnc"
    """Back ends of slamstitch, with commas between: gnc, none (every stitch is kept)."""
    inject: float = 0.0
    """Run slamstitch again with so many false stitches that they are this share of all."""
    format: Format = "table"
    """What is printed on stdout."""


@dataclass(frozen=True)
class RobustnessOptions(StudyOptions):
    """What each corruption of a recording does to the answers of the methods, as ratios to the clean drives.

    Spoil every drive in every way at three severities, one at a time, and let every method map it. Errors are
    ate_rmse where there is truth, else relation_trans_mean. Writes results.csv, ratios.png and index.html.
    What there is to spoil: `python -m scenarios.run --list-corruptions`.
    """

    scenarios: str = "hospital,office_smoke"
    """Scenarios of the catalogue, with commas between; "" for none, where there are logs."""
    seeds: str = "70-74"
    """Seeds of the drives and of what spoils them: first-last, or numbers with commas between. A log is
    spoilt anew by each seed where chance has a part."""
    out: Folder = Path("runs/ablate-robustness")
    """A folder for results.csv, the page and sweep.sqlite, from which an interrupted sweep goes on."""
    logs: str = ""
    """Files of recordings, with commas between."""
    relations: str = ""
    """Files of relations, one for each log, with commas between; nothing between two for a log with truth."""
    kinds: str = ""
    """Corruptions by name, with commas between; all without a name."""
    severities: str = "low,medium,high"
    """Which of the three severities, with commas between."""
    methods: str = "ins,wsm,slamstitch"
    """Methods by name, with commas between."""
    format: Format = "table"
    """What is printed on stdout."""


@dataclass(frozen=True)
class SegmentationOptions(StudyOptions):
    """Which measure knows that the robot is lost, and what its cuts are worth to the map.

    Let ManifoldSLAM track every drive, and score every measure of confidence against the truth. Then let each
    cut every drive, at a threshold learnt on other scenarios, and map what is left. Writes results.csv, the
    figures and index.html.
    """

    scenarios: str = "hospital,office_smoke,collapsed,outdoor"
    """Scenarios of the catalogue, with commas between; those that thresholds were learnt on are beehive,
    corridor, twin_rooms and two_drives."""
    seeds: str = "20"
    """Seeds: how many, counted from 0; or first-last; or numbers with commas between."""
    out: Folder = Path("runs/ablate-segmentation")
    """A folder for results.csv, the page and sweep.sqlite, from which an interrupted sweep goes on."""
    measures: str = ""
    """Measures by name, with commas between; all without a name."""
    no_maps: bool = False
    """Score the measures only; let nothing be cut."""
    thorough: bool = False
    """Map with slamstitch's own settings, which takes about twice as long."""
    format: Format = "table"
    """What is printed on stdout."""


@dataclass(frozen=True)
class StitchingOptions(StudyOptions):
    """How often two submaps of one building are joined rightly, wrongly or not at all, by true overlap.

    Cut pairs of submaps from two simulated drives through a building, and let every method align them.
    Submaps are fragments of a drive (``--length``), drawn at the poses that the front end estimated; before
    the second drive through every third building half the furniture is moved. Overlap is the share of the
    smaller map's known area that both drives have seen, from the true poses. An alignment is right within
    0.3 m (at the middle of the overlap) and 2°. The prior has a standard deviation of 1 m on each axis and
    10°, and errors as large.
    """

    scenarios: str = "hospital,beehive,office_smoke,two_drives,twin_rooms"
    """Scenarios of the catalogue, with commas between; twin_rooms has a bin of its own."""
    seeds: str = "0-19"
    """Seeds: first-last, or numbers with commas between; more are used only while a bin is not full."""
    out: Folder = Path("runs/ablate-stitching")
    """A folder for results.csv and sweep.sqlite, from which a sweep that was interrupted goes on."""
    pairs: int = 100
    """Pairs per bin; fewer where the seeds do not give as many."""
    methods: str = ""
    """Methods by name, with commas between; all without a name."""
    length: Annotated[tuple[float, float], arg(metavar="SHORTEST LONGEST")] = (30.0, 60.0)
    """Metres of drive that make a submap; those of 30–60 m are of about 30 × 20 m."""
    format: Format = "table"
    """What is printed on stdout."""


@dataclass(frozen=True)
class SelfConsistencyOptions(StudyOptions):
    """Whether a map knows without truth that it is torn: self_consistency against the true error.

    Simulate every scenario with every seed, spoil every recording by each of some corruptions, and let every
    method map all of them. A map is called torn when its error is so many times that of slamstitch on the
    honest drive (``--times``); told is how well self_consistency ranks torn maps below the others (area under
    the ROC curve), and what its verdict "torn" finds and misses.
    """

    scenarios: str = "hospital,office_smoke,two_drives,collapsed,outdoor,twin_rooms"
    """Scenarios of the catalogue, with commas between."""
    seeds: str = "20-21"
    """Seeds: how many, counted from 0; or first-last; or numbers with commas between."""
    out: Folder = Path("runs/ablate-self-consistency")
    """A folder for results.csv and sweep.sqlite, from which a sweep that was interrupted goes on."""
    corruptions: str = "odometry.frozen,odometry.late,odometry.slip,laser.dropped,laser.noise"
    """Corruptions by name, each at its default severity, with commas between; the honest drive comes
    first."""
    methods: str = "slamstitch,wsm"
    """Methods by name, with commas between; "slamstitch" always runs on the honest drive."""
    times: float = 5.0
    """How many times the error of slamstitch on the honest drive a map must have to be called torn."""
    format: Format = "table"
    """What is printed on stdout."""


STUDIES: dict[str, type] = {
    "belief": BeliefOptions,
    "bends": BendsOptions,
    "confidence": ConfidenceOptions,
    "halmstad": HalmstadOptions,
    "likeness": LikenessOptions,
    "methods": MethodsOptions,
    "robustness": RobustnessOptions,
    "ros_maps": RosMapsOptions,
    "segmentation": SegmentationOptions,
    "self_consistency": SelfConsistencyOptions,
    "stitching": StitchingOptions,
}
"""Studies by name: `scenarios.ablate.study.<name>` runs one with its options."""
