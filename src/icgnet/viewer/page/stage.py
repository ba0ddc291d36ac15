"""What every panel of the page is given."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import viser
from jaxtyping import Float

from icgnet.inference.prediction import Prediction


@dataclass(frozen=True, eq=False)
class Stage:
    """The page, what is shown on it, and in which frame.

    Attributes:
        server: of the page.
        prediction: what was found.
        T_table_frame: from the frame of the prediction to the scene's.
        changed: to be called when something else is to be shown.
    """

    server: viser.ViserServer
    prediction: Prediction
    T_table_frame: Float[np.ndarray, "4 4"]
    changed: Callable[[], None]

    def watch(self, *controls: Any) -> None:
        """Shows what the controls ask for whenever one of them is used."""
        for control in controls:
            control.on_update(lambda _: self.changed())
