"""The tools over the protocol: in this process, and as a client starts them."""

import asyncio
import base64
import io
import os
import sys

import numpy as np
import pytest
from PIL import Image

pytest.importorskip("mcp", reason="needs icgnet[mcp]")

from mcp import StdioServerParameters
from mcp.client import Client

from http_service import DEPTH, POSE, HeldUpPredictor, known_prediction
from icgnet.agents.captures import CaptureFolder
from icgnet.agents.server import create_server
from icgnet.agents.sight import LocalSight, Scene
from icgnet.agents.tools import Tools
from icgnet.cli.main import main
from icgnet.network.weights import save_weights
from tabletop_scenes import INTRINSICS, tiny_network

TOOLS = ["look", "list_objects", "grasp", "pick"]


@pytest.fixture
def folder(tmp_path):
    captures = tmp_path / "captures"
    captures.mkdir()
    np.savez(captures / "view.npz", depth=DEPTH, K=INTRINSICS, camera_pose=POSE)
    return captures


def asked(server, *questions: tuple[str, dict]):
    """The tools of a server, and its answers."""

    async def ask():
        async with Client(server) as client:
            return (await client.list_tools()).tools, [await client.call_tool(*question) for question in questions]

    return asyncio.run(asyncio.wait_for(ask(), 300))


def text(answer) -> str:
    return " ".join(block.text for block in answer.content if block.type == "text")


def made(folder, predictor=None, plans=None):
    return create_server(Tools(CaptureFolder(folder), LocalSight(predictor or HeldUpPredictor(), Scene()), plans))


def test_a_client_sees_the_tools_and_that_they_only_read(folder, tmp_path):
    tools, _ = asked(made(folder))
    assert [tool.name for tool in tools] == TOOLS
    assert all(tool.annotations.read_only_hint for tool in tools)
    assert all(tool.description for tool in tools)
    assert tools[3].input_schema["required"] == ["drop"]
    writing, _ = asked(made(folder, plans=tmp_path))
    assert [tool.annotations.read_only_hint for tool in writing] == [True, True, True, False]
    assert writing[3].annotations.destructive_hint is False


def test_answers_are_a_picture_text_and_values(folder):
    _, (look, objects, grasp) = asked(made(folder), ("look", {}), ("list_objects", {}), ("grasp", {"limit": 1}))
    picture = next(block for block in look.content if block.type == "image")
    with Image.open(io.BytesIO(base64.b64decode(picture.data))) as image:
        assert (image.format, image.width) == ("PNG", 960)
    assert "view.npz" in text(look)
    assert len(objects.structured_content["objects"]) == len(known_prediction().objects)
    assert grasp.structured_content["grasps"][0]["pose"] == known_prediction().grasps.poses[0].tolist()


@pytest.mark.parametrize(
    ("question", "said"),
    [
        (("look", {"capture": "../captures/view.npz"}), "no capture '../captures/view.npz'; the captures are view.npz"),
        (("look", {"capture": 5}), "capture"),
        (("list_objects", {"capture": "none.png"}), "no capture 'none.png'"),
        (("grasp", {"object_class": "unicorn"}), "no class 'unicorn'"),
        (("grasp", {"limit": "many"}), "limit"),
        (("pick", {}), "drop"),
        (("pick", {"drop": [1, 2, 3, 4]}), "drop"),
        (("pick", {"drop": [0.1, 0.4]}), "drop must have shape (3,), got (2,)"),
        (("pick", {"drop": [0.1, 0.4, 0.2]}), "there is no arm to plan for"),
        (("open_file", {"path": "/etc/hostname"}), "open_file"),
    ],
)
def test_bad_input_is_an_error_of_the_tool_and_the_server_goes_on(folder, question, said):
    server = made(folder)

    async def ask():
        async with Client(server) as client:
            try:
                answer = await client.call_tool(*question)
                wrong = text(answer) if answer.is_error else "no error"
            except Exception as error:  # an unknown tool is an error of the protocol
                wrong = str(error)
            return wrong, await client.call_tool("list_objects", {})

    wrong, after = asyncio.run(asyncio.wait_for(ask(), 60))
    assert said in wrong
    assert not after.is_error


def test_faults_of_the_server_tell_an_agent_nothing(folder):
    predictor = HeldUpPredictor()
    predictor.error = RuntimeError("secret")
    _, (answer,) = asked(made(folder, predictor), ("look", {}))
    assert answer.is_error
    assert "secret" not in text(answer)


@pytest.mark.slow
def test_a_client_starts_the_command_and_asks_over_stdio(folder, tmp_path):
    weights = tmp_path / "tiny.safetensors"
    save_weights(weights, tiny_network(), {})
    words = ["-m", "icgnet.cli.main", "mcp", str(folder), "--weights", str(weights), "--threads", "1"]
    kept = {name: value for name, value in os.environ.items() if name in ("PYTHONPATH", "OMP_NUM_THREADS", "PATH")}
    process = StdioServerParameters(command=sys.executable, args=words, env=kept)
    outside = ("look", {"capture": "../tiny.safetensors"})
    tools, (look, grasp, refused) = asked(process, ("look", {}), ("grasp", {"limit": 1}), outside)
    assert [tool.name for tool in tools] == TOOLS
    assert [block.type for block in look.content] == ["image", "text"]
    np.testing.assert_allclose(
        grasp.structured_content["grasps"][0]["pose"], known_prediction().grasps.poses[0], atol=1e-4
    )
    assert refused.is_error
    assert "no capture" in text(refused)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["none"], "no such folder of captures: none"),
        ([".", "--url", "robot:8000"], "url must begin with http:// or https://, got 'robot:8000'"),
        (
            [".", "--url", "http://robot", "--arm", "fr3"],
            "arm does not go with url: the service at http://robot has its",
        ),
        ([".", "--url", "http://robot", "--pick.speed", "0.5"], "pick does not go with url"),
        ([".", "--hand-eye", "eye.yaml"], "hand_eye is for an arm: give --arm, too, or --camera-pose"),
        ([".", "--weights", "none.safetensors"], "none.safetensors: no such weights file"),
        ([".", "--url", "http://robot", "--timeout", "0"], "timeout must be at least 0.1"),
        ([".", "--depth-scale", "0"], "depth_scale must be above 0"),
        ([".", "--threads", "0"], "threads must be at least 1"),
    ],
)
def test_what_is_wrong_at_the_start_is_one_line(arguments, said, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["mcp", *arguments]) == 2
    err = capsys.readouterr().err
    assert said in err
    assert err.count("\n") == 1


def test_without_the_extra_it_says_what_to_install(capsys, monkeypatch, tmp_path):
    monkeypatch.delitem(sys.modules, "icgnet.agents.server", raising=False)
    monkeypatch.setitem(sys.modules, "mcp.server.mcpserver", None)
    assert main(["mcp", str(tmp_path)]) == 2
    assert capsys.readouterr().err == 'error: icgnet mcp needs more packages: pip install "icgnet[mcp]"\n'
