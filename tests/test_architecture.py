"""Imports point one way, and heavy packages stay in the folder that needs them (docs/architecture.md)."""

import ast
import builtins
import dis
import importlib
import re
import subprocess
import sys
from functools import cache
from pathlib import Path
from types import CodeType

import pytest

import icgnet
from icgnet.errors import MissingExtraError

PACKAGE = Path(icgnet.__file__).parent

FOUNDATION = {"errors", "files", "machine", "output_folder", "settings"}
"""The modules that stand below everything; beside them there are the predictor, on top of the folder `inference`, and
the client of the service, which stands alone."""

MAY_IMPORT = {
    "foundation": set(),
    "geometry": {"foundation"},
    "grasping": {"foundation", "geometry"},
    "objects": {"foundation", "geometry"},
    "network": {"foundation", "geometry", "grasping", "objects"},
    "simulation": {"foundation", "geometry", "grasping", "objects"},
    "parallel": {"foundation"},
    "sensors": {"foundation", "geometry", "objects", "simulation"},
    "datagen": {"foundation", "geometry", "grasping", "objects", "simulation", "parallel"},
    "training": {
        "foundation",
        "geometry",
        "grasping",
        "objects",
        "network",
        "simulation",
        "sensors",
        "datagen",
        "parallel",
    },
    "inference": {"foundation", "geometry", "grasping", "objects", "network"},
    "predictor": {"foundation", "geometry", "grasping", "objects", "network", "inference"},
    "arm": {"foundation", "geometry", "grasping", "inference"},
    "camera_calibration": {"foundation", "geometry"},
    "viewer": {"foundation", "geometry", "grasping", "inference", "predictor", "arm"},
    "service": {"foundation", "geometry", "objects", "network", "inference", "predictor", "arm"},
    "ros2": {"foundation", "geometry", "grasping", "inference", "predictor"},
    "client": {"foundation"},
    "doctor": {"foundation", "inference", "network", "predictor"},
    "agents": {"foundation", "geometry", "inference", "predictor", "arm", "viewer", "client"},
    "benchmark": {
        *("foundation", "geometry", "grasping", "objects", "network", "simulation", "sensors", "datagen"),
        *("parallel", "training", "inference", "predictor", "arm", "viewer"),
    },
}
MAY_IMPORT["studies"] = {"benchmark", *MAY_IMPORT["benchmark"]}
MAY_IMPORT["cli"] = set(MAY_IMPORT)

AT_HOME = {
    "mujoco": {"simulation"},
    "ray": {"parallel"},
    "lightning_fabric": {"training"},
    "lightning": {"training"},
    "viser": {"viewer"},
    "matplotlib": {"viewer"},
    "pyarrow": {"datagen"},
    "tyro": {"cli"},
    "torch": {"network", "training", "inference", "predictor", "benchmark", "studies"},
    "embreex": {"geometry"},
    "coacd": {"objects"},
    "pinocchio": {"arm"},
    "coal": {"arm"},
    "frankik": {"arm"},
    "roboplan": {"arm"},
    "cv2": {"camera_calibration"},
    "fastapi": {"service"},
    "starlette": {"service"},
    "uvicorn": {"service"},
    "prometheus_client": {"service"},
    "httpx": {"client"},
    "cyclonedds": {"ros2"},
    "mcp": {"agents"},
}
"""Packages that only these layers know."""

MODULES = sorted(path.relative_to(PACKAGE) for path in PACKAGE.rglob("*.py") if path != PACKAGE / "__init__.py")


def layer_of(first: str) -> str:
    """Layer of a top-level folder or module of the package."""
    return "foundation" if first in FOUNDATION else first


@cache
def parsed(module: Path) -> ast.Module:
    return ast.parse((PACKAGE / module).read_text())


@cache
def imported(module: Path) -> frozenset[str]:
    """Full names of everything that a module imports, also inside of functions."""
    names = set()
    for node in ast.walk(parsed(module)):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{module}: relative import"
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return frozenset(names)


def run_python(code: str) -> str:
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120).stdout


def test_every_folder_has_its_place_in_the_table():
    folders = {path.parts[0] for path in MODULES if len(path.parts) > 1}
    assert folders <= set(MAY_IMPORT)


@pytest.mark.parametrize("module", MODULES, ids=str)
def test_imports_point_one_way(module):
    layer = layer_of(module.parts[0] if len(module.parts) > 1 else module.stem)
    used = {
        layer_of(name.split(".")[1])
        for name in imported(module)
        if name.startswith("icgnet.") and name != "icgnet.__version__"
    }
    assert used <= MAY_IMPORT[layer] | {layer}


@pytest.mark.parametrize("package", sorted(AT_HOME))
def test_a_heavy_package_is_imported_only_at_home(package):
    users = {
        layer_of(module.parts[0] if len(module.parts) > 1 else module.stem)
        for module in MODULES
        if any(name.split(".")[0] == package for name in imported(module))
    }
    assert users <= AT_HOME[package]


@pytest.mark.parametrize("module", MODULES, ids=str)
def test_every_global_name_is_defined(module):
    # Linters cannot tell: the letters of jaxtyping's shapes look like names to them.
    name = ".".join(("icgnet", *module.with_suffix("").parts)).removesuffix(".__init__")
    if {"arm", "workcell"} & set(module.parts) or module.stem in ("pick_picture", "picking"):
        pytest.importorskip("icgnet.arm.libraries", reason="needs icgnet[arm]", exc_type=MissingExtraError)
    if "camera_calibration" in module.parts:
        pytest.importorskip(
            "icgnet.camera_calibration.libraries", reason="needs icgnet[calibrate]", exc_type=MissingExtraError
        )
    if "ros2" in module.parts:
        pytest.importorskip("icgnet.ros2.dds", reason="needs icgnet[ros2]", exc_type=MissingExtraError)
    known = {*vars(importlib.import_module(name)), *vars(builtins)}
    codes = [compile((PACKAGE / module).read_text(), str(module), "exec")]
    for code in codes:
        codes += [each for each in code.co_consts if isinstance(each, CodeType)]
        used = {each.argval for each in dis.get_instructions(code) if each.opname == "LOAD_GLOBAL"}
        assert used <= known, f"{code.co_qualname} uses {sorted(used - known)}"


def test_help_loads_neither_torch_nor_the_physics_engine():
    code = (
        "import sys\n"
        "from icgnet.cli.main import main\n"
        "assert main(['--help']) == 0\n"
        "print('loaded:', *{'torch', 'mujoco', 'viser', 'lightning_fabric'} & set(sys.modules))"
    )
    output = run_python(code)
    assert "predict" in output
    assert output.splitlines()[-1].strip() == "loaded:"


def test_pictures_of_saved_results_need_no_torch():
    code = "import sys, icgnet.viewer.picture, icgnet.viewer.web\nprint({'torch', 'mujoco'} & set(sys.modules))"
    assert run_python(code).strip() == "set()"


def test_the_version_is_known_without_loading_anything():
    assert run_python("import sys, icgnet\nprint(icgnet.__version__, 'numpy' in sys.modules)").split()[1] == "False"


def test_the_paper_map_names_only_what_exists():
    text = (PACKAGE.parent.parent / "docs" / "paper_map.md").read_text()
    named = re.findall(r"`([a-z_/]+\.py)(?::([A-Za-z_.]+))?`", text)
    assert len(named) > 40
    missing = [(path, name) for path, name in named if not defines(PACKAGE / path, name)]
    assert missing == []


def defines(path: Path, name: str) -> bool:
    """Whether a module exists and defines a function, class, constant or method (`Class.method`)."""
    if not path.is_file():
        return False
    scope = parsed(path.relative_to(PACKAGE)).body
    for part in filter(None, name.split(".")):
        found = [node for node in scope if part in names_of(node)]
        if not found:
            return False
        scope = getattr(found[0], "body", [])
    return True


def names_of(node: ast.stmt) -> set[str]:
    if isinstance(node, ast.FunctionDef | ast.ClassDef):
        return {node.name}
    if isinstance(node, ast.Assign):
        return {target.id for target in node.targets if isinstance(target, ast.Name)}
    return {node.target.id} if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name) else set()


ARRAYS = re.compile(r"np\.ndarray|\bTensor\b|\bTrimesh\b")


def array_dataclasses_that_compare(module: Path) -> list[str]:
    """Dataclasses of a module that hold arrays, whose truth nobody knows, and compare them all the same."""
    found = []
    for node in ast.walk(parsed(module)):
        decorators = [ast.unparse(each) for each in node.decorator_list] if isinstance(node, ast.ClassDef) else []
        if not any(each.startswith("dataclass") and "eq=False" not in each for each in decorators):
            continue
        has_arrays = any(isinstance(line, ast.AnnAssign) and ARRAYS.search(ast.unparse(line)) for line in node.body)
        if has_arrays and not any(getattr(line, "name", None) == "__eq__" for line in node.body):
            found.append(f"{module}: {node.name}")
    return found


def test_dataclasses_with_arrays_are_compared_by_identity_or_know_better():
    compared = [name for module in MODULES for name in array_dataclasses_that_compare(module)]
    assert compared == []
