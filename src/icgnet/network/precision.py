"""In how many bits the U-Nets compute: bfloat16 pays where the processor has instructions for it, and only there.

Others emulate it: on a processor without them a 30^3 convolution took 17 to 28 times as long as in 32 bits.
"""

import os

import torch

from icgnet.errors import InputError
from icgnet.network.config import Precision

NATIVE = ("_is_amx_tile_supported", "_is_avx512_bf16_supported")
"""Functions of `torch.cpu` that tell what a processor can; older versions of torch lack some."""
ISA_WITH_BFLOAT16 = ("ALL", "DEFAULT", "BF16", "FP16", "AMX", "AVX10")
"""Parts of the names of the limits of oneDNN (ONEDNN_MAX_CPU_ISA) that leave it these instructions."""


def has_bfloat16(device: torch.device) -> bool:
    """Whether a device multiplies bfloat16 with instructions of its own, and torch may use them."""
    if device.type == "cuda":
        return torch.cuda.is_bf16_supported(including_emulation=False)
    if device.type != "cpu" or not torch.backends.cpu.get_cpu_capability().startswith("AVX512"):
        return False
    limit = os.environ.get("ONEDNN_MAX_CPU_ISA", "ALL").upper()
    may = any(part in limit for part in ISA_WITH_BFLOAT16)
    return may and any(getattr(torch.cpu, name, lambda: False)() for name in NATIVE)


def use_bfloat16(precision: Precision, device: torch.device) -> bool:
    """Whether to compute in bfloat16: as told, or by what the device can."""
    return has_bfloat16(device) if precision == "auto" else precision == "bfloat16"


def describe_auto() -> str:
    """What `auto` takes on this processor, and the instructions that torch computes with."""
    chosen = "bfloat16" if has_bfloat16(torch.device("cpu")) else "float32"
    return f"{chosen} here; torch computes with {torch.backends.cpu.get_cpu_capability()}"


def check_device(device: str | torch.device) -> torch.device:
    """A device that torch can compute on.

    Raises:
        InputError: torch knows no such device, or this machine has none.
    """
    try:
        found = torch.device(device)
        torch.zeros(1, device=found).add(1)
    except (RuntimeError, AssertionError, NotImplementedError, TypeError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(f"device {str(device)!r} cannot be used: {reason}") from error
    return found
