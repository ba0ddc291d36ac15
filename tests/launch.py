"""Starts commands with `torchrun`, on CPU."""

import subprocess
import sys

TOGETHER = ["--standalone", "--nproc-per-node=2"]
"""Two processes of this machine."""


def torchrun(options: list[str], *arguments: object) -> subprocess.Popen:
    """Starts the processes; their printed lines can be read from `stdout`.

    Args:
        options: of torchrun.
        arguments: what each process runs: a script, or `-m` and a module, and its arguments.
    """
    launch = [sys.executable, "-m", "torch.distributed.run", *options, *map(str, arguments)]
    return subprocess.Popen(launch, stdout=subprocess.PIPE, text=True)


def icgnet_together(*arguments: object) -> subprocess.Popen:
    """Two processes of the command line; `--` keeps torchrun from reading options that look like its own."""
    return torchrun(TOGETHER, "-m", "icgnet.cli.main", "--", *arguments)


def output_of(*processes: subprocess.Popen) -> str:
    """What processes that must succeed print."""
    said = [process.communicate(timeout=300)[0] for process in processes]
    assert [process.returncode for process in processes] == [0] * len(processes)
    return "".join(said)
