"""What is printed about a prediction."""

import io
import re

from rich.console import Console

from arm_scenes import box, boxes_seen
from icgnet.cli.report import print_tables


def test_what_is_said_of_an_object_is_one_line_however_narrow_the_window():
    text = io.StringIO()
    found = boxes_seen([box((0.05, 0.04, 0.10)), box((0.05, 0.04, 0.06), x=0.27)], grasped=(0,))
    print_tables(found, Console(file=text, width=40), meshes=False)
    told = r"^no grasp on 1 \w+: reasons were not saved for each object; predict again$"
    assert re.search(told, text.getvalue(), re.MULTILINE)
