"""The command `icgnet`: finds the subcommand, parses its arguments, and turns errors into one line and an exit code.

A subcommand is a dataclass whose fields are its arguments, and which does its work in `run`. Only the module of the one
that is asked for is imported, and none of them imports anything heavy before it runs.
"""

import importlib
import io
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stderr
from typing import Annotated, Any, Union

from icgnet.errors import IcgnetError

COMMANDS = {
    "demo": ("demo:Demo", "Find objects and grasps in the depth images that ship with the package."),
    "predict": ("predict:Predict", "Find objects and grasps in a depth image or a cloud."),
    "pick": ("pick:Pick", "Plan how an arm picks an object up, carries it and lets go of it."),
    "calibrate-camera": (
        "calibrate_camera:CalibrateCamera",
        "Find where a camera is, on an arm or beside it, from pictures of a printed board.",
    ),
    "view": ("view:View", "Look at a saved prediction or at a planned pick in the browser."),
    "serve": ("serve:Serve", "Answer predictions over HTTP, for robots and other programs."),
    "ros2": ("ros2:Ros2", "Answer depth images of ROS 2 with grasps and objects, without ROS on this machine."),
    "mcp": (
        "mcp:Mcp",
        "Give agents tools over the Model Context Protocol, on stdin and stdout: look, list_objects, grasp, pick.",
    ),
    "generate": ("generate:Generate", "Make labelled scenes in simulation, as Parquet files."),
    "dataset inspect": (
        "dataset:Inspect",
        "Print the data card of labelled scenes.",
    ),
    "train cpu": ("train:TrainCpu", "Train a network on a processor with a few cores, in an evening."),
    "train paper": (
        "train:TrainPaper",
        "Train the network of the paper as published.",
    ),
    "train tiny": ("train:TrainTiny", "Train a small network for a few steps, to see that everything works."),
    "curves": ("curves:Curves", "Draw loss and validation of one or several training runs into one picture."),
    "calibrate": ("calibrate:Calibrate", "Make a score of 0.9 mean nine successes in ten."),
    "evaluate": ("evaluate:Evaluate", "Print the metrics of weights on generated scenes."),
    "benchmark clutter": ("benchmark_clutter:Clutter", "Let a planner grasp scenes empty, and count."),
    "benchmark target": ("benchmark:Target", "Grasp one named object, hidden more or less by others."),
    "benchmark workcell": (
        "benchmark_workcell:Workcell",
        "Let a simulated arm with a camera on its wrist clear a table into a box, or fetch one object, and count.",
    ),
    "benchmark reconstruction": ("benchmark:Reconstruction", "Predicted shapes against true ones."),
    "benchmark segmentation": ("benchmark:Segmentation", "Predicted instances against true ones."),
    "benchmark latency": ("benchmark:Latency", "Time of each stage from a cloud or depth image to grasps."),
    "benchmark captures": ("benchmark:Captures", "Objects and grasps in real frames against labels or clicks."),
    "benchmark report": ("benchmark_report:Report", "Put the results of several benchmarks beside the published ones."),
    "study simulation": ("study:Simulation", "Scenes and grasps of the simulator beside the published ones."),
    "study hands": ("study:Hands", "How hands close on objects whose widths are known."),
    "study grasp-scores": ("study:GraspScores", "What scores are worth where they are used."),
    "study label-ceiling": ("study:LabelCeiling", "The best that scores of grasps can reach."),
    "study loader": ("study:Loader", "How many scenes a second one core makes ready for training."),
    "study sensor-noise": ("study:SensorNoise", "Noise and edges of real depth images beside simulated ones."),
    "study training-speed": ("study:TrainingSpeed", "Where the time of a training step goes."),
    "simulate": ("simulate:Simulate", "Take a noisy depth image of a simulated scene."),
    "sensors": ("sensors:Sensors", "Draw what each sensor model does to the cloud of a simulated scene."),
    "objects check": ("objects:CheckObjects", "Check a folder of URDFs or meshes: what is wrong with which file."),
    "gripper check": (
        "gripper:CheckGripper",
        "Check a gripper file, print the measures of the hand, draw it.",
    ),
    "doctor": (
        "doctor:Doctor",
        "Tell what is installed, what is missing, and whether a prediction works, and how fast.",
    ),
    "version": ("version:Version", "Print the version."),
}
"""Name of a subcommand, one or two words -> where in this folder it is, and what it does."""

DESCRIPTION = "One depth image of a cluttered table in; objects, complete shapes and ranked grasps out."
USAGE_ERROR = 2
INTERRUPTED = 130


def main(argv: Sequence[str] | None = None) -> int:
    """Exit code of the command line: 0, or 2 when the caller can mend the error.

    Args:
        argv: arguments without the program's name; those of the process if None.
    """
    words = list(sys.argv[1:] if argv is None else argv) or ["--help"]
    words[0] = {"--version": "version", "-V": "version"}.get(words[0], words[0])
    if words[0].replace("-", " ", 1) in COMMANDS:  # as the completion writes them
        words[:1] = words[0].split("-", 1)
    name = next((name for name in (" ".join(words[:2]), words[0]) if name in COMMANDS), "")
    if not name and not words[0].startswith("--tyro-"):
        return _no_command(words)
    try:
        parse(words).run()
    except SystemExit as stop:
        return stop.code if isinstance(stop.code, int) else int(stop.code is not None)
    except (IcgnetError, OSError) as error:
        print("error:", " ".join(str(error).split()), file=sys.stderr)
        return USAGE_ERROR
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return INTERRUPTED
    return 0


def _no_command(words: Sequence[str]) -> int:
    """Prints the commands: all of them, or those whose first word is the given one."""
    first = words[0]
    asked = {"-h", "--help", "help"}
    group = {name: about for name, about in COMMANDS.items() if name.split()[0] == first}
    if first in asked or (group and (len(words) == 1 or words[1] in asked)):
        print(_overview(group or COMMANDS))
        return 0
    wrong, valid = (" ".join(words[:2]), group) if group else (first, COMMANDS)
    print(f"error: no command {wrong!r}; the commands are {', '.join(valid)}", file=sys.stderr)
    return USAGE_ERROR


def parse(words: Sequence[str]) -> Any:
    """The subcommand that the words begin with, with the arguments that follow; nothing is run.

    `--tyro-print-completion bash` and its like, in place of a name, print the completion of all subcommands.

    Raises:
        SystemExit: arguments that it does not take, after a message, or a wish for help.
        InputError: values that are out of range.
    """
    import tyro

    for count in (2, 1):
        name = " ".join(words[:count])
        if name in COMMANDS:
            with _own_errors():
                return tyro.cli(load_command(name), prog=f"icgnet {name}", args=words[count:])
    every = tuple(Annotated[load_command(name), tyro.conf.subcommand(name.replace(" ", "-"))] for name in COMMANDS)
    return tyro.cli(Union[every], prog="icgnet", args=words)  # noqa: UP007  # pyright: ignore


@contextmanager
def _own_errors() -> Iterator[None]:
    """What the settings themselves say of a value comes as their error, without what the parser makes of it."""
    said = io.StringIO()
    try:
        with redirect_stderr(said):
            yield
    except SystemExit as stop:
        cause: BaseException | None = stop
        while cause is not None and not isinstance(cause, IcgnetError):
            cause = cause.__context__
        if cause is not None:
            raise cause from None
        sys.stderr.write(said.getvalue())
        raise


def load_command(name: str) -> Any:
    """The dataclass of a subcommand."""
    module, _, kind = COMMANDS[name][0].partition(":")
    return getattr(importlib.import_module(f"icgnet.cli.{module}"), kind)


def _overview(commands: Mapping[str, tuple[str, str]]) -> str:
    width = max(map(len, commands))
    lines = [f"  {name:{width}}  {summary}" for name, (_, summary) in commands.items()]
    ends = (
        "icgnet COMMAND --help lists the options of a command; icgnet --version prints the version.",
        "icgnet --tyro-print-completion bash (or zsh, tcsh) prints a script that completes commands in the shell.",
    )
    return "\n".join(("usage: icgnet COMMAND [OPTIONS]", "", DESCRIPTION, "", *lines, "", *ends))


if __name__ == "__main__":
    sys.exit(main())
