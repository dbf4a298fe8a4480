"""Tests of the package: protocol messages, wheel, versions, documentation."""

from __future__ import annotations

import ast
import operator
import re
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from google.protobuf import descriptor_pb2

import avln
import avln.habitat
import avln.rollouts
from avln.cli import main
from avln.v1 import common_pb2, info_pb2, play_pb2, run_pb2, task_pb2

if TYPE_CHECKING:
    from collections.abc import Iterable

PACKAGE = Path(__file__).resolve().parents[1]
PROTO = PACKAGE.parents[1] / "proto"
MODULES = {"common": common_pb2, "info": info_pb2, "play": play_pb2, "run": run_pb2, "task": task_pb2}


def test_every_proto_file_has_module() -> None:
    assert {path.stem for path in (PROTO / "avln" / "v1").glob("*.proto")} == set(MODULES)


@pytest.mark.parametrize("name", sorted(MODULES))
def test_messages_match_proto_files(name: str, tmp_path: Path) -> None:
    pytest.importorskip("grpc_tools", reason="pip install grpcio-tools")
    out = tmp_path / "set"
    command = [sys.executable, "-m", "grpc_tools.protoc", f"-I{PROTO}", f"--descriptor_set_out={out}"]
    subprocess.run([*command, str(PROTO / "avln" / "v1" / f"{name}.proto")], check=True, timeout=120)
    expected = descriptor_pb2.FileDescriptorSet.FromString(out.read_bytes()).file[0]
    generated = descriptor_pb2.FileDescriptorProto.FromString(MODULES[name].DESCRIPTOR.serialized_pb)
    for file in (expected, generated):
        for message in file.message_type:
            for field in message.field:
                field.ClearField("json_name")
    assert expected == generated, "run tools/generate.py"


def test_wheel_and_sdist_contain_package_and_licences(tmp_path: Path) -> None:
    for needed in ("build", "hatchling"):
        pytest.importorskip(needed, reason=f"pip install {needed}")
    # The build makes the source archive first, then the wheel from it.
    command = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(tmp_path), str(PACKAGE)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=250)
    assert done.returncode == 0, done.stdout + done.stderr
    name = f"avln-{avln.__version__}"
    with zipfile.ZipFile(tmp_path / f"{name}-py3-none-any.whl") as wheel:
        wheeled = set(wheel.namelist())
    with tarfile.open(tmp_path / f"{name}.tar.gz") as source:
        sourced = set(source.getnames())
    files = [path for path in (PACKAGE / "src" / "avln").rglob("*") if path.is_file() and path.suffix != ".pyc"]
    modules = {path.relative_to(PACKAGE / "src").as_posix() for path in files}
    assert {path for path in wheeled if path.startswith("avln/")} == modules
    assert {f"{name}/src/{path}" for path in modules} <= sourced
    licences = ("LICENSE-MIT", "LICENSE-APACHE")
    assert {f"{name}.dist-info/licenses/{licence}" for licence in licences} <= wheeled
    assert {f"{name}/{licence}" for licence in licences} <= sourced
    for licence in licences:
        assert (PACKAGE / licence).read_text() == (PACKAGE.parents[1] / licence).read_text()


def fields_of(messages: Iterable[Any]) -> dict[str, set[str]]:
    return {message.name: {field.name for field in message.fields} for message in messages}


@pytest.mark.parametrize(("module", "needed"), [("avln.gym", "gymnasium"), ("avln.bridge", "msgpack")])
def test_missing_dependency_error_names_extra(module: str, needed: str) -> None:
    code = f"import sys; sys.modules[{needed!r}] = None; import {module}"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=120)
    assert f"{module} needs {needed}; pip install 'avln[{module.split('.')[1]}]'" in done.stderr


def annotated(node: ast.ClassDef) -> list[ast.AnnAssign]:
    return [item for item in node.body if isinstance(item, ast.AnnAssign)]


@pytest.mark.parametrize("name", sorted(MODULES))
def test_type_stubs_have_all_message_fields(name: str) -> None:
    tree = ast.parse((PACKAGE / "src" / "avln" / "v1" / f"{name}_pb2.pyi").read_text())
    classes = [node for node in tree.body if isinstance(node, ast.ClassDef)]
    typed = {node.name: {ast.unparse(item.target) for item in annotated(node)} for node in classes}
    for message, fields in fields_of(MODULES[name].DESCRIPTOR.message_types_by_name.values()).items():
        assert fields <= typed[message], f"{message}: run tools/generate.py"


def test_versions_agree() -> None:
    version = re.search(r'^version = "(.+)"$', (PACKAGE / "pyproject.toml").read_text(), re.MULTILINE)
    assert version is not None
    assert version.group(1) == avln.__version__
    minor = re.search(r"API_MINOR: u32 = (\d+)", (PROTO / "src" / "lib.rs").read_text())
    assert minor is not None
    assert int(minor.group(1)) == avln.version.API_MINOR


def test_files_and_functions_are_short() -> None:
    for path in PACKAGE.rglob("*.py"):
        if "_pb2" in path.name or any(part.startswith((".", "build")) for part in path.relative_to(PACKAGE).parts):
            continue
        text = path.read_text()
        assert len(text.splitlines()) <= 500, path
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef):
                assert (node.end_lineno or 0) - node.lineno < 70, f"{path}: {node.name}"


def test_core_needs_no_extras() -> None:
    hidden = "import sys; sys.modules.update(dict.fromkeys(['gymnasium', 'zmq', 'msgpack', 'tqdm', 'torch']))"
    code = f"{hidden}; import avln, avln.habitat, avln.cli; print(avln.__version__)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120)
    assert done.stdout.strip() == avln.__version__


PAGES = [PACKAGE / "README.md", PACKAGE.parents[1] / "docs" / "python.md"]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_documented_code_and_commands_exist(page: Path) -> None:
    pytest.importorskip("avln.gym", reason="pip install 'avln[gym]'", exc_type=ImportError)
    text = page.read_text()
    blocks = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    assert blocks
    for block in blocks:
        for name in re.findall(r"\bavln((?:\.\w+)+)", block):
            assert operator.attrgetter(name[1:])(avln) is not None, name
        ast.parse(block)
    for command in re.findall(r"^\$ avln-py (\w+)", text, re.MULTILINE):
        with pytest.raises(SystemExit) as ended:
            main([command, "--help"])
        assert ended.value.code == 0, command


def test_exported_names_exist() -> None:
    assert set(avln.__all__) <= set(dir(avln))
    assert (PACKAGE / "src" / "avln" / "py.typed").is_file()
