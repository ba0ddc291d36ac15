"""The tools over the Model Context Protocol, on stdin and stdout."""

import asyncio
import base64
import io
from collections.abc import Callable
from typing import Annotated, Any, TypeVar

from mcp.server.mcpserver import MCPServer
from mcp.server.mcpserver.exceptions import ToolError
from mcp.types import CallToolResult, ImageContent, TextContent, ToolAnnotations
from pydantic import Field

from icgnet import __version__
from icgnet.agents.tools import Tools
from icgnet.errors import IcgnetError
from icgnet.files import finite

Result = TypeVar("Result")

INSTRUCTIONS = (
    "Objects and grasps in depth images of cluttered tables, and plans for an arm. No tool moves anything: a plan "
    "is to be looked at, and carried out by somebody else. Lengths are metres, joint positions radians; frame_id names "
    "the frame that coordinates are in: in 'camera' x is right, y down, z forward; in any other z is up. Look first: "
    "objects keep their instance_id as long as the capture stays the same. Without a capture the newest one is taken, "
    "which may be another one the next time: name it to stay with it, and mind age_seconds."
)

CaptureName = Annotated[
    str | None, Field(description="Name of a capture, as `captures` lists them; the newest one if left out.")
]
ClassName = Annotated[str | None, Field(description="Objects of this class only, one of `classes`.")]
InstanceId = Annotated[int | None, Field(description="This object only, by its instance_id in this capture.")]


def create_server(tools: Tools) -> MCPServer:
    """The server with the tools `look`, `list_objects`, `grasp` and `pick`."""
    server = MCPServer("icgnet", version=__version__, instructions=INSTRUCTIONS, log_level="WARNING")
    reads = ToolAnnotations(read_only_hint=True, idempotent_hint=True, open_world_hint=False)
    writes = ToolAnnotations(read_only_hint=False, destructive_hint=False, idempotent_hint=False, open_world_hint=False)

    @server.tool(title="Look at a capture", annotations=reads)
    async def look(capture: CaptureName = None) -> CallToolResult:
        """A picture of what the camera saw, objects coloured and numbered, and a table of them.

        The table tells class, where, how large and how many grasps.
        """
        seen = await _answer(lambda: tools.look(capture))
        content = io.BytesIO()
        seen.picture.save(content, "PNG")
        picture = ImageContent(type="image", data=base64.b64encode(content.getvalue()).decode(), mime_type="image/png")
        return CallToolResult(
            content=[picture, TextContent(type="text", text=seen.table)], structured_content=_plain(seen.scene)
        )

    @server.tool(title="List the objects in a capture", annotations=reads)
    async def list_objects(capture: CaptureName = None) -> dict[str, Any]:
        """The objects in a capture as values.

        Of each its instance_id, class, scores, middle and size of what is seen [m] and number of grasps; also the names
        of all captures, and why grasps were rejected.
        """
        return _plain(await _answer(lambda: tools.list_objects(capture)))

    @server.tool(title="Find grasps", annotations=reads)
    async def grasp(
        capture: CaptureName = None,
        object_class: ClassName = None,
        instance_id: InstanceId = None,
        limit: Annotated[int, Field(description="So many grasps at most, 1 to 50, the best ones.")] = 3,
    ) -> dict[str, Any]:
        """The best collision-free grasps of a parallel-jaw hand.

        Of each its pose (z approach, y closing, origin midway between the finger tips), opening [m] and score (the
        probability of success). If there are none, `rejected` counts why.
        """
        return _plain(await _answer(lambda: tools.grasp(capture, object_class, instance_id, limit)))

    @server.tool(title="Plan a pick", annotations=writes if tools.writes else reads)
    async def pick(
        drop: Annotated[
            list[float],
            Field(description="Where the object is let go of: its lowest point, x y z in the world [m].", max_length=3),
        ],
        capture: CaptureName = None,
        object_class: ClassName = None,
        instance_id: InstanceId = None,
        release: Annotated[
            str | None, Field(description="drop, or place: lower the object onto the drop-off point.")
        ] = None,
    ) -> dict[str, Any]:
        """A plan by which the robot's arm takes an object and lets go of it at a point; NOTHING MOVES.

        It is checked against collisions, and somebody else has to carry it out. If found is false, `refused` counts
        why.
        """
        return _plain(await _answer(lambda: tools.pick(drop, capture, object_class, instance_id, release)))

    return server


def serve_tools(tools: Tools) -> None:
    """Answers on stdin and stdout until stdin ends."""
    create_server(tools).run("stdio")


async def _answer(question: Callable[[], Result]) -> Result:
    """The answer to a question, found beside the event loop; what the caller can mend as an error of the tool."""
    try:
        return await asyncio.to_thread(question)
    except IcgnetError as error:
        raise ToolError(" ".join(str(error).split())) from error


def _plain(values: dict[str, Any]) -> Any:
    """Values without numbers that are not finite, which JSON has none of."""
    return finite(values)
