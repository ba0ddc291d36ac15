"""The command `icgnet`: parses its arguments, runs a subcommand and turns errors into one line and an exit code.

Nothing heavy is imported before a subcommand runs, so that `icgnet --help` answers at once.
"""

import sys
from collections.abc import Sequence
from typing import Annotated

import tyro

from icgnet.cli.benchmark import Benchmark
from icgnet.cli.calibrate import Calibrate
from icgnet.cli.curves import Curves
from icgnet.cli.dataset import Dataset
from icgnet.cli.demo import Demo
from icgnet.cli.evaluate import Evaluate
from icgnet.cli.generate import Generate
from icgnet.cli.gripper import Gripper
from icgnet.cli.objects import Objects
from icgnet.cli.predict import Predict
from icgnet.cli.sensors import Sensors
from icgnet.cli.simulate import Simulate
from icgnet.cli.study import Study
from icgnet.cli.train import Train
from icgnet.cli.version import Version
from icgnet.cli.view import View
from icgnet.errors import IcgnetError

USAGE_ERROR = 2
INTERRUPTED = 130

Command = (
    Annotated[Demo, tyro.conf.subcommand("demo")]
    | Annotated[Predict, tyro.conf.subcommand("predict")]
    | Annotated[View, tyro.conf.subcommand("view")]
    | Annotated[Generate, tyro.conf.subcommand("generate")]
    | Annotated[Dataset, tyro.conf.subcommand("dataset")]
    | Annotated[Train, tyro.conf.subcommand("train")]
    | Annotated[Curves, tyro.conf.subcommand("curves")]
    | Annotated[Calibrate, tyro.conf.subcommand("calibrate")]
    | Annotated[Evaluate, tyro.conf.subcommand("evaluate")]
    | Annotated[Benchmark, tyro.conf.subcommand("benchmark")]
    | Annotated[Study, tyro.conf.subcommand("study")]
    | Annotated[Simulate, tyro.conf.subcommand("simulate")]
    | Annotated[Sensors, tyro.conf.subcommand("sensors")]
    | Annotated[Objects, tyro.conf.subcommand("objects")]
    | Annotated[Gripper, tyro.conf.subcommand("gripper")]
    | Annotated[Version, tyro.conf.subcommand("version")]
)

DESCRIPTION = "One depth image of a cluttered table in; objects, complete shapes and ranked grasps out."


def main(argv: Sequence[str] | None = None) -> int:
    """Exit code of the command line: 0, or 2 when the caller can mend the error.

    Args:
        argv: arguments without the program's name; those of the process if None.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    if arguments in (["--version"], ["-V"]):
        arguments = ["version"]
    try:
        command = tyro.cli(Command, prog="icgnet", description=DESCRIPTION, args=arguments or ["--help"])  # pyright: ignore
        command.run()
    except SystemExit as stop:
        return stop.code if isinstance(stop.code, int) else int(stop.code is not None)
    except (IcgnetError, OSError) as error:
        print("error:", " ".join(str(error).split()), file=sys.stderr)
        return USAGE_ERROR
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return INTERRUPTED
    return 0


if __name__ == "__main__":
    sys.exit(main())
