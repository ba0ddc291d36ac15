"""Pictures of a board by a camera on an arm and by one beside it."""

from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from rendered_boards import Taken


@pytest.fixture(scope="session")
def on_arm() -> "Taken":
    from rendered_boards import on_the_arm

    return on_the_arm()


@pytest.fixture(scope="session")
def beside_arm() -> "Taken":
    from rendered_boards import beside_the_arm

    return beside_the_arm()
