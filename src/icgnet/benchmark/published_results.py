"""What papers print about methods on packed and pile scenes: facts, each with its source and how it was measured.

Values are texts, digit by digit as printed: "mean ± population standard deviation" where we have seen one. Sources:

- ICG-Net: Zurbrügg et al., ICRA 2024, arXiv 2401.09939; cameras and noise from its benchmark code.
- OrbitGrasp: Hu et al., CoRL 2024, arXiv 2407.03531; cameras and noise from its code.
- EVG: Song et al., "Equivariant Volumetric Grasping", arXiv 2507.18847v2.
- NeuGraspNet: Jauhri et al., RSS 2024, arXiv 2306.07392.
"""

from dataclasses import dataclass

NOT_GIVEN = "-"
AUTHORS = "its authors"
VGN_TEST = "VGN test objects"


@dataclass(frozen=True)
class PublishedRates:
    """Grasp success rate and declutter rate of one method, in percent.

    Attributes:
        method: name of it.
        packed_gsr: on packed scenes.
        packed_dr: on packed scenes.
        pile_gsr: on piles.
        pile_dr: on piles.
        measured_by: who ran the method.
        protocol: its rules, cameras and noise, where they are not those of its table.
    """

    method: str
    packed_gsr: str
    packed_dr: str
    pile_gsr: str
    pile_dr: str
    measured_by: str = AUTHORS
    protocol: str | None = None


@dataclass(frozen=True)
class PublishedTable:
    """Rates that one source measured in one way.

    Attributes:
        source: paper and table.
        view: ours that comes nearest.
        noise: ours that comes nearest.
        protocol: its rules, cameras and noise.
        scenes: objects and rounds.
        rows: the methods.
    """

    source: str
    view: str
    noise: str
    protocol: str
    scenes: str
    rows: tuple[PublishedRates, ...]


_EDGE_CAMERA = "edge; camera 0.60 to 0.75 m, 45 to 60 degrees from the vertical"
_EDGE = f"{_EDGE_CAMERA}; 0.8 mm on the points"
_EDGE_DEPTH = f"{_EDGE_CAMERA}; 0.8 mm on the depth of each pixel"
_EDGE_UNCHECKED = f"{_EDGE_CAMERA}; noise not checked"
_FROM_EDGE_GRASP = "authors of Edge-Grasp"
_BY_ICG_NET = "authors of ICG-Net"
_UNEXPLAINED = "authors of EVG, probably; retrained or not is not known"

RATES: tuple[PublishedTable, ...] = (
    PublishedTable(
        "ICG-Net, comparison on synthetic data",
        *("random", "gaussian", _EDGE, f"{VGN_TEST}, 4 x 100 rounds"),
        rows=(
            PublishedRates("ICG-Net", "97.7 ± 0.9", "97.5 ± 0.3", "92.0 ± 2.6", "94.1 ± 1.4"),
            PublishedRates(
                "VN-EdgeGraspNet",
                "90.4 ± 2.5",
                "92.8 ± 1.0",
                "91.9 ± 0.8",
                "92.7 ± 1.2",
                f"{_BY_ICG_NET}, re-evaluated",
            ),
            PublishedRates(
                "EdgeGraspNet", "90.6 ± 0.9", "93.9 ± 0.7", "91.0 ± 2.0", "93.7 ± 2.3", f"{_BY_ICG_NET}, re-evaluated"
            ),
            PublishedRates(
                *("GIGA-HR", "91.4 ± 1.5", "88.5 ± 1.4", "86.5 ± 1.2", "80.8 ± 1.9"),
                *(f"{_BY_ICG_NET}, retrained", _EDGE_DEPTH),
            ),
            PublishedRates(
                *("GIGA", "89.9 ± 1.7", "87.6 ± 2.0", "76.3 ± 2.4", "80.9 ± 4.1"),
                *(f"{_BY_ICG_NET}, retrained", _EDGE_DEPTH),
            ),
            PublishedRates(
                *("VGN", "80.2 ± 1.6", "86.2 ± 2.0", "64.9 ± 2.2", "69.1 ± 3.2", _FROM_EDGE_GRASP, _EDGE_UNCHECKED)
            ),
            PublishedRates(
                *("PointNetGPD", "79.3 ± 1.8", "82.5 ± 2.9", "75.6 ± 2.3", "77.0 ± 2.8"),
                *(_FROM_EDGE_GRASP, _EDGE_UNCHECKED),
            ),
        ),
    ),
    PublishedTable(
        "OrbitGrasp, Tables 1 and 4",
        "random",
        "gaussian",
        "edge; camera 0.45 to 0.60 m, 45 to 75 degrees from the vertical; none or 0.5 mm on the points; table kept",
        VGN_TEST,
        rows=(
            PublishedRates("OrbitGrasp, 6 M grasps", "98.3 ± 0.7", "98.8 ± 0.6", "96.7 ± 1.1", "97.9 ± 0.5"),
            PublishedRates("OrbitGrasp, 3 M grasps", "98.4 ± 0.5", "98.8 ± 0.3", "96.3 ± 0.3", "97.7 ± 0.7"),
            PublishedRates("OrbitGrasp, 1 M grasps", "97.3 ± 0.7", "98.7 ± 0.4", "94.1 ± 0.6", "97.0 ± 0.3"),
            PublishedRates("VN-EdgeGraspNet", "91.6 ± 1.7", "94.4 ± 1.5", "92.0 ± 1.8", "92.2 ± 2.1", "not said"),
        ),
    ),
    PublishedTable(
        "EVG, Table II",
        *("random", "gaussian", "rules and random camera after Edge-Grasp; range and noise not checked", VGN_TEST),
        rows=(
            PublishedRates("EquiIGD", "95.8 ± 0.3", "96.8 ± 0.9", "90.1 ± 0.7", "94.5 ± 1.5"),
            PublishedRates("EquiGIGA HR", "95.2 ± 1.9", "96.9 ± 0.6", "94.1 ± 1.2", "85.7 ± 1.5"),
            PublishedRates("EquiGIGA", "95.8 ± 1.4", "97.1 ± 1.2", "90.0 ± 0.7", "86.2 ± 0.7"),
        ),
    ),
    PublishedTable(
        "NeuGraspNet, Table I",
        *("random", "gaussian", "its own rules, random camera; range and noise not checked", f"{VGN_TEST}, 5 seeds"),
        rows=(PublishedRates("NeuGraspNet", "92.49 ± 1.41", "91.74 ± 1.24", "85.05 ± 1.25", "84.37 ± 1.52"),),
    ),
    PublishedTable(
        "EVG, Table I",
        "side",
        "dex",
        "GIGA's rules (the first picture without a grasp ends a round) and presumably its simulation (the hand stops "
        "at its first contact, masses of the URDFs, other scales); camera at 0.60 m, 60 degrees; "
        "gamma noise on the depth",
        f"{VGN_TEST}, 100 rounds a seed",
        rows=(
            PublishedRates("EquiIGD", "97.4 ± 1.6", "91.4 ± 1.4", "78.6 ± 2.1", "78.0 ± 3.0"),
            PublishedRates("EquiGIGA", "96.8 ± 1.0", "88.6 ± 1.3", "76.6 ± 2.5", "76.4 ± 2.9"),
            PublishedRates("EquiIGD HR", "96.0 ± 0.8", "92.4 ± 1.4", "74.9 ± 1.2", "73.0 ± 0.8"),
            PublishedRates("EquiGIGA HR", "93.1 ± 1.2", "91.8 ± 1.3", "78.6 ± 1.0", "75.5 ± 1.3"),
            PublishedRates("IGD", "92.9 ± 1.8", "86.7 ± 1.8", "68.2 ± 1.9", "50.6 ± 1.5", "not said"),
            PublishedRates("GIGA", "84.8 ± 2.2", "85.1 ± 2.5", "69.5 ± 1.3", "49.0 ± 3.4", "not said"),
            PublishedRates("VGN", "72.5", "76.7", "59.3", "43.5", "not said"),
            PublishedRates("OrbitGrasp", "71.1 ± 1.8", "72.8 ± 1.6", "69.3 ± 2.1", "64.7 ± 3.3", _UNEXPLAINED),
            PublishedRates("ICG-Net", "60.3 ± 4.1", "64.5 ± 5.9", "57.3 ± 1.5", "51.7 ± 3.3", _UNEXPLAINED),
            PublishedRates("VN-EdgeGraspNet", "60.6 ± 2.2", "60.1 ± 3.8", "55.0 ± 2.1", "50.1 ± 4.0", _UNEXPLAINED),
        ),
    ),
    PublishedTable(
        "ICG-Net, challenging viewpoints",
        *("top", "gaussian", "edge; camera 0 to 2 degrees from the vertical; 0.8 mm on the points", VGN_TEST),
        rows=(
            PublishedRates("ICG-Net, seen points only", NOT_GIVEN, "85", NOT_GIVEN, "72"),
            PublishedRates("ICG-Net, surfaces resampled", NOT_GIVEN, "90", NOT_GIVEN, "94"),
        ),
    ),
    PublishedTable(
        "NeuGraspNet, Table I",
        *("top", "gaussian", "its own rules, camera fixed at the top; noise not checked", f"{VGN_TEST}, 5 seeds"),
        rows=(PublishedRates("NeuGraspNet", "97.65 ± 0.92", "93.16 ± 1.48", "86.51", "83.52"),),
    ),
)
"""Clutter removal, the tables of each view and noise in the order in which they are shown."""


@dataclass(frozen=True)
class PublishedShapes:
    """Reconstruction of whole scenes.

    Attributes:
        method: name of it.
        protocol: cameras and noise.
        scenes: objects and how many scenes.
        packed_iou: in percent.
        packed_chamfer: Chamfer-L1 [mm].
        pile_iou: in percent.
        pile_chamfer: Chamfer-L1 [mm].
        measured_by: who ran the method, and where it is printed.
    """

    method: str
    protocol: str
    scenes: str
    packed_iou: str
    packed_chamfer: str
    pile_iou: str
    pile_chamfer: str
    measured_by: str


_ICG_SHAPES = ("single view, cameras and noise not said", f"{VGN_TEST}, 100 scenes")
_ICG_TABLE = "(ICG-Net, comparison on synthetic data)"

SHAPES: tuple[PublishedShapes, ...] = (
    PublishedShapes(
        "ICG-Net", *_ICG_SHAPES, "84 ± 6.1", "2.3 ± 1.1", "77 ± 9.9", "2.9 ± 1.9", f"{AUTHORS} {_ICG_TABLE}"
    ),
    PublishedShapes(
        "GIGA",
        *_ICG_SHAPES,
        *("82 ± 6.9", "2.5 ± 1.2", "71 ± 8.6", "3.4 ± 1.4"),
        f"{_BY_ICG_NET}, retrained {_ICG_TABLE}",
    ),
    PublishedShapes(
        "NeuGraspNet",
        *("its own views", "its own split of the VGN objects"),
        *("89.39", NOT_GIVEN, "73.22", NOT_GIVEN),
        f"{AUTHORS} (NeuGraspNet, Table IX)",
    ),
)
"""Ours are measured on the same kind of scenes, with the metrics of docs/benchmark.md."""


@dataclass(frozen=True)
class PublishedTime:
    """Time of one prediction, as its source defines it.

    Attributes:
        method: name of it.
        milliseconds: of the whole.
        hardware: that it ran on.
        measured_by: who ran the method, and where it is printed.
    """

    method: str
    milliseconds: str
    hardware: str
    measured_by: str


_RTX_3080, _RTX_4070 = "NVIDIA RTX 3080", "NVIDIA RTX 4070"
_ICG_TIMES = "(ICG-Net, model size and runtime)"
_EVG_TIMES = "(EVG, Table I)"

TIMES: tuple[PublishedTime, ...] = (
    PublishedTime("ICG-Net", "138", _RTX_3080, f"{AUTHORS} {_ICG_TIMES}"),
    PublishedTime("VN-EdgeGraspNet", "306", _RTX_3080, f"{_BY_ICG_NET} {_ICG_TIMES}"),
    PublishedTime("EdgeGraspNet", "34", _RTX_3080, f"{_BY_ICG_NET} {_ICG_TIMES}"),
    PublishedTime("GIGA-HR", "66", _RTX_3080, f"{_BY_ICG_NET} {_ICG_TIMES}"),
    PublishedTime("GIGA", "30", _RTX_3080, f"{_BY_ICG_NET} {_ICG_TIMES}"),
    PublishedTime("VGN", "7", _RTX_3080, f"{_BY_ICG_NET} {_ICG_TIMES}"),
    PublishedTime("ICG-Net", "806", _RTX_4070, f"authors of EVG, probably {_EVG_TIMES}"),
    PublishedTime("EquiIGD", "147", _RTX_4070, f"{AUTHORS} {_EVG_TIMES}"),
    PublishedTime("EquiGIGA", "65", _RTX_4070, f"{AUTHORS} {_EVG_TIMES}"),
    PublishedTime("OrbitGrasp", "3193", "NVIDIA RTX A6000", f"authors of EVG, probably {_EVG_TIMES}"),
    PublishedTime("NeuGraspNet", "865", "not known", f"{AUTHORS} (NeuGraspNet, Table VI)"),
)
