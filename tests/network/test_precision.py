import pytest
import torch

from icgnet.errors import InputError
from icgnet.network.precision import NATIVE, check_device, has_bfloat16, use_bfloat16

CPU = torch.device("cpu")


@pytest.fixture
def new_processor(monkeypatch):
    """A processor that multiplies bfloat16, and that torch may use wholly."""
    monkeypatch.setattr(torch.backends.cpu, "get_cpu_capability", lambda: "AVX512")
    monkeypatch.setattr(torch.cpu, NATIVE[1], lambda: True, raising=False)
    monkeypatch.delenv("ONEDNN_MAX_CPU_ISA", raising=False)


def test_auto_is_bfloat16_where_the_processor_has_it(new_processor):
    assert use_bfloat16("auto", CPU)


@pytest.mark.parametrize("limit", ["AVX2", "SSE41", "AVX512_CORE", "avx512_core_vnni"])
def test_a_limit_of_the_library_counts(new_processor, monkeypatch, limit):
    monkeypatch.setenv("ONEDNN_MAX_CPU_ISA", limit)
    assert not use_bfloat16("auto", CPU)


def test_a_limit_of_torch_counts(new_processor, monkeypatch):
    monkeypatch.setattr(torch.backends.cpu, "get_cpu_capability", lambda: "AVX2")
    assert not use_bfloat16("auto", CPU)


def test_an_older_processor_computes_in_32_bits(new_processor, monkeypatch):
    for name in NATIVE:
        monkeypatch.setattr(torch.cpu, name, lambda: False, raising=False)
    assert not use_bfloat16("auto", CPU)


@pytest.mark.parametrize("precision", ["float32", "bfloat16"])
def test_what_is_told_counts_on_any_processor(precision):
    assert use_bfloat16(precision, CPU) == (precision == "bfloat16")


def test_other_devices_are_not_known_to_have_it():
    assert not has_bfloat16(torch.device("meta"))


@pytest.mark.parametrize("device", ["nowhere", "cuda:99"])
def test_a_device_that_is_not_there_is_named(device):
    with pytest.raises(InputError, match=f"device '{device}' cannot be used"):
        check_device(device)
