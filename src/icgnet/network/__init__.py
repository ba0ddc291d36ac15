"""The network: sparse and dense U-Net, queries, decoders, surface extraction."""
