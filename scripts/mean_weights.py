"""The mean of weights that began from one another, which is often better than any of them.

python scripts/mean_weights.py FIRST.safetensors SECOND.safetensors [...] --out MEAN.safetensors

Weights of two ends of one training lie in one valley of the loss, and their mean lies deeper in it (Wortsman et al.
2022, "Model soups"). The file is stored in 16 bits; `icgnet calibrate` comes after.
"""

import argparse
from pathlib import Path

import torch

from icgnet.network.weights import load_weights, save_weights
from icgnet.network.weights_header import read_header


def main() -> None:
    """Reads the files, and writes their mean."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("weights", nargs="+", type=Path)
    parser.add_argument("--out", required=True, type=Path)
    asked = parser.parse_args()
    network, metadata = load_weights(asked.weights[0])
    states = [load_weights(path, network.config)[0].state_dict() for path in asked.weights]
    mean = {
        name: torch.stack([state[name].double() for state in states]).mean(0).to(tensor.dtype)
        for name, tensor in states[0].items()
    }
    network.load_state_dict(mean)
    told = {key: metadata[key] for key in ("step", "scenes") if key in metadata}
    save_weights(
        asked.out, network, told | {"mean_of": [read_header(path).sha256 for path in asked.weights]}, half=True
    )


if __name__ == "__main__":
    main()
