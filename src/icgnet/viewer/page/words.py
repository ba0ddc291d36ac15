"""What the page says: objects, grasps, and why there is none. Plain texts, and HTML for the panels."""

from collections.abc import Sequence
from html import escape

from icgnet.geometry.transforms import matrix_to_quaternion
from icgnet.grasping.grasps import Grasps
from icgnet.inference.prediction import DetectedObject, Prediction
from icgnet.viewer.describe import SEPARATOR, dropped_text, main_reason, summary
from icgnet.viewer.palette import REASON_COLOURS, instance_colour, to_bytes

LIST_HEIGHT, NOTES_HEIGHT = "12em", "4.5em"
"""Longer lists scroll, so that they push nothing off the page."""
QUIET, ALERT = "#6b7280", "#b42318"


def header(prediction: Prediction) -> str:
    """The numbers of the result, its frame and hand, and whatever the caller should know."""
    poor = len(prediction.objects) - len(set(prediction.grasps.instances.tolist()))
    told = [f"<b>{escape(summary(prediction))}</b>"]
    if poor:
        told.append(f'<span style="color:{ALERT}">{poor} object{"s" * (poor != 1)} without a grasp</span>')
    hand = prediction.gripper
    told.append(
        f"frame <code>{escape(prediction.frame_id)}</code>{SEPARATOR}hand <code>{escape(hand.name)}</code>, "
        f"opens {1e3 * hand.max_opening:.0f} mm"
    )
    left_out = ", ".join(f"{count} {what}" for what, count in prediction.left_out.items() if count)
    notes = [*prediction.warnings, *([f"left out: {left_out}"] if left_out else [])]
    if notes:
        quiet = f"color:{QUIET};max-height:{NOTES_HEIGHT};overflow:auto"
        told.append(f'<div style="{quiet}">{"<br>".join(map(escape, notes))}</div>')
    return _block("<br>".join(told))


def object_line(prediction: Prediction, item: DetectedObject) -> str:
    """Number, class and grasps of an object, as in the list to choose from; no two objects have the same."""
    return f"{item.instance_id} {item.class_name} \u00b7 {_counted(_grasps_of(prediction, item))}"


def object_label(prediction: Prediction, item: DetectedObject) -> str:
    """What floats over an object: number and class, and whether there is no grasp; short, for there may be many."""
    name = f"{item.instance_id} {item.class_name}"
    return name if len(_grasps_of(prediction, item)) else f"{name}: 0 grasps"


def object_list(prediction: Prediction) -> str:
    """All objects, each with its grasps and best score, or with the reason beside "0 grasps"."""
    rows = []
    for item in prediction.objects:
        own = _grasps_of(prediction, item)
        if len(own):
            told = f"<td>{_counted(own)}</td><td>best {own.scores.max():.2f}</td>"
        else:
            reason = escape(main_reason(prediction, item.instance_id))
            told = f'<td style="color:{ALERT}">0 grasps</td><td style="color:{ALERT}">{reason}</td>'
        name = f"{item.instance_id} {escape(item.class_name)}"
        rows.append(f"<tr><td>{_swatch(instance_colour(item.instance_id))} {name}</td>{told}</tr>")
    return _list(rows) if rows else _block("no object was found")


def object_details(prediction: Prediction, item: DetectedObject) -> str:
    """One object: what it is taken for, its size, its best grasp, and why candidates were dropped."""
    own = _grasps_of(prediction, item)
    mesh = item.mesh()
    size = " x ".join(f"{100 * edge:.1f}" for edge in mesh.extents) + " cm" if not mesh.is_empty else "unknown"
    lines = [
        ("class", f"{escape(item.class_name)} {100 * item.class_score:.0f}%"),
        ("one whole object", f"{item.score:.2f}"),
        ("size", size),
    ]
    counted = _counted(own)
    head = f"<b>{counted}</b>" if len(own) else f'<b style="color:{ALERT}">{counted}</b>'
    dropped = dropped_text(prediction, item.instance_id)
    told = f'{head}<div style="color:{QUIET}">dropped: {escape(dropped)}</div>'
    return _pairs(lines) + _block(told)


def grasp_details(grasps: Grasps, g: int, frame_id: str, reason: str | None) -> str:
    """One grasp in numbers, in the frame of the prediction; `reason` says why it was dropped."""
    pose = grasps.poses[g]
    lines = [
        ("score", f"{grasps.scores[g]:.2f}"),
        ("width / opening", f"{1e3 * grasps.widths[g]:.0f} / {1e3 * grasps.openings[g]:.0f} mm"),
        (f"TCP in {escape(frame_id)}", " ".join(f"{value:.3f}" for value in pose[:3, 3]) + " m"),
        ("quaternion wxyz", " ".join(f"{value:.3f}" for value in matrix_to_quaternion(pose[:3, :3]))),
        ("approach", " ".join(f"{value:.2f}" for value in pose[:3, 2])),
    ]
    is_first = not (grasps.instances[:g] == grasps.instances[g]).any()
    title = (
        f"<b>{'Best grasp' if is_first else 'Grasp'}</b>"
        if reason is None
        else f'<b style="color:{ALERT}">Rejected: {escape(reason)}</b>'
    )
    return _block(title) + _pairs(lines)


def reason_legend(names: Sequence[tuple[str, str]]) -> str:
    """The colours of rejected grasps: pairs of a reason and what is said about it."""
    entries = [f"<tr><td>{_swatch(REASON_COLOURS[reason])} {escape(text)}</td></tr>" for reason, text in names]
    return _list(entries)


def _grasps_of(prediction: Prediction, item: DetectedObject) -> Grasps:
    return prediction.grasps.select(prediction.grasps.instances == item.instance_id)


def _counted(grasps: Grasps) -> str:
    return f"{len(grasps)} grasp{'s' * (len(grasps) != 1)}"


def _swatch(colour: tuple[float, float, float]) -> str:
    return f'<span style="color:rgb{to_bytes(colour)}">\u25a0</span>'


def _list(rows: Sequence[str]) -> str:
    table = f'<table style="width:100%;border-collapse:collapse;white-space:nowrap">{"".join(rows)}</table>'
    return _block(f'<div style="max-height:{LIST_HEIGHT};overflow:auto">{table}</div>')


def _pairs(lines: Sequence[tuple[str, str]]) -> str:
    rows = [f'<tr><td style="color:{QUIET};padding-right:1em">{name}</td><td>{told}</td></tr>' for name, told in lines]
    return _list(rows)


def _block(content: str) -> str:
    return f'<div style="font-size:0.85em;line-height:1.5;padding:0.2em 0.5em">{content}</div>'
