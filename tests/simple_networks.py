"""Networks whose grasps follow a rule that can be said in a sentence."""

import torch
from torch import nn

from icgnet.network.config import NETWORKS
from icgnet.network.hand_decoder import HandDecoder
from icgnet.network.icgnet import IcgNet


def network_that_likes_hands_from_above(scale: float = 3.0) -> IcgNet:
    """A tiny network whose logits are `scale` times (1.5 - vertical part of the approach) - 6."""
    torch.manual_seed(0)
    network = IcgNet(NETWORKS["tiny"]).eval()
    decoder = network.affordance
    assert isinstance(decoder, HandDecoder)
    with torch.no_grad():
        for layer in (decoder.of_hand, decoder.of_contact, decoder.success):
            layer.weight.zero_()
            if isinstance(layer, nn.Linear) and layer.bias is not None:
                layer.bias.zero_()
        # The last input of `of_hand` is the vertical part of the approach: -1 for a hand that comes straight down.
        decoder.of_hand.weight[0, -1] = -1.0
        decoder.of_hand.bias[0] = 1.5
        decoder.success.weight[0, 0] = scale
        decoder.success.bias.fill_(-6.0)
    return network
