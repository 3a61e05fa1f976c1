"""Imports go one way, and what is foreign has one door.

``common`` ← ``replay`` ← ``learner`` ← ``deploy``; ``common`` ← ``actors`` ← ``viewer``;
``benchmarks`` and tests above all. An import counts wherever it stands, also inside a function, and
so does ``"module:name"`` as text, except in the registry, whose purpose that is.
"""

import ast
import re
from collections.abc import Iterator

import pytest

from tests.paths import ROOT

ARROWS = {
    "common": set(),
    "replay": {"common"},
    "learner": {"common", "replay"},
    "actors": {"common"},
    "viewer": {"common", "actors"},
    "deploy": {"common", "learner"},
    "ale_robot": {"common", "deploy", "learner", "actors", "viewer"},
    "benchmarks": {"common", "replay", "learner", "actors", "viewer", "deploy", "ale_robot"},
    "docs": {"common"},
}
"""By package, the others that it may import."""

DOORS: dict[str, str | tuple[str, ...]] = {
    "zenoh": "common/transport/zenoh_",
    "pybullet": "actors/robots/",
    "pybullet_data": "actors/robots/",
    "pybullet_utils": "actors/robots/",
    "tensorboard": "learner/telemetry/sinks/",
    "prometheus_client": ("common/exposition.py", "learner/telemetry/sinks/"),
    "starlette": ("common/process/http_server.py", "learner/telemetry/web/"),
    "uvicorn": "common/process/http_server.py",
    "wandb": "learner/telemetry/sinks/",
    "mlflow": "learner/telemetry/sinks/",
    "trackio": "learner/telemetry/sinks/",
    "optuna": "benchmarks/lab/sweep.py",
    "huggingface_hub": "ale_robot/",
    "pyarrow": "common/dataset/",
    "cryptography": (
        *("common/transport/credentials.py", "common/transport/signature.py"),
        *("deploy/certificates.py", "benchmarks/chaos/certificates.py"),
    ),
    "ray": ("deploy/ray_cluster.py", "deploy/ray_keepers.py"),
}
"""By foreign package, the file or folder that alone imports it."""


WITHIN_COMMON = {
    "process": set(),
    "settings": set(),
    "protocol": {"settings"},
    "transport": {"process", "protocol"},
    "run": {"process", "protocol", "settings", "transport"},
    "command_line": {"run", "settings", "transport"},
    "dataset": {"protocol", "run", "settings"},
    "native": {"process", "protocol", "settings"},
}
"""By folder of `common`, the others that it may import."""


REGISTRY = "common/registry.py"
AS_TEXT = re.compile(r"(\w+(\.\w+)+):[\w.]*")


def imported(source: str) -> Iterator[str]:
    """Every package, module and name that ``source`` imports absolutely."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            assert node.module is not None
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def named_as_text(source: str) -> Iterator[str]:
    """Every module of a ``"module:name"`` in ``source``, whose name may follow later."""
    for node in ast.walk(ast.parse(source)):
        text = node.value if isinstance(node, ast.Constant) else None
        if isinstance(text, str) and (match := AS_TEXT.fullmatch(text)):
            yield match[1]


def against_the_rules(path: str, source: str) -> set[tuple[str, str]]:
    """The file and what it imports, for each import that it may not have."""
    own = path.split("/")[0]
    found = set()
    texts = [] if path == REGISTRY else list(named_as_text(source))
    for module in (*imported(source), *texts):
        package = module.split(".")[0]
        foreign = package in ARROWS and package not in {own, *ARROWS[own]}
        if foreign or not path.startswith(DOORS.get(package, "")):
            found.add((path, package))
    return found


def sources() -> Iterator[tuple[str, str]]:
    """All modules of the product: path below the repository, and text."""
    for package in ARROWS:
        for path in sorted((ROOT / package).rglob("*.py")):
            yield path.relative_to(ROOT).as_posix(), path.read_text()


def test_imports_go_one_way_and_through_the_doors() -> None:
    found = set().union(*(against_the_rules(*each) for each in sources()))
    assert sorted(found) == []


def test_the_folders_of_common_are_in_layers() -> None:
    """What lies beside them counts, too: `settings` must not reach `run` by way of a module."""
    reached: dict[str, set[str]] = {}

    def reach(module: str) -> set[str]:
        """Folders of `common` that `module` imports, itself or through modules beside them."""
        if module not in reached:
            reached[module] = set()
            path = ROOT / f"{module.replace('.', '/')}.py"
            for name in imported(path.read_text()) if path.is_file() else ():
                top, folder, *_ = *name.split("."), ""
                if top == "common":
                    reached[module] |= {folder} if folder in WITHIN_COMMON else reach(name)
        return reached[module]

    found = {
        (path, folder)
        for path, _ in sources()
        if path.startswith("common/") and (own := path.split("/")[1]) in WITHIN_COMMON
        for folder in reach(path.removesuffix(".py").replace("/", ".")) - {own}
        if folder not in WITHIN_COMMON[own]
    }
    assert sorted(found) == []
    inside = (path.split("/") for path, _ in sources() if path.startswith("common/"))
    assert {parts[1] for parts in inside if len(parts) > 2} == WITHIN_COMMON.keys()


def test_whoever_can_do_without_a_network_gets_a_transport() -> None:
    """Only commands, and benchmarks of processes, open one."""
    opening = {
        path
        for path, source in sources()
        if "common.transport.chosen" in set(imported(source)) and not path.startswith("benchmarks/")
    }
    roles = {"actors/process.py", "replay/__main__.py"}
    assert opening == {*roles, "learner/endpoints.py", "learner/status.py"}


def test_the_transport_is_chosen_in_one_place() -> None:
    own = ("common/transport/zenoh_", "benchmarks/second_router.py")  # a router is Zenoh's alone
    choosing = {
        path
        for path, source in sources()
        if any(module.startswith("common.transport.zenoh_") for module in imported(source))
        and not path.startswith(own)
    }
    assert choosing == {"common/transport/chosen.py"}


@pytest.mark.parametrize(
    ("path", "source", "package"),
    [
        ("common/transport/requests.py", "import replay.batch as batch", "replay"),
        ("replay/ring.py", "from learner.training import Learner", "learner"),
        ("replay/ring.py", "def f():\n    from actors import envs", "actors"),
        ("learner/training.py", "if True:\n    import os, actors.games", "actors"),
        ("actors/loop.py", "from replay.ring import Ring", "replay"),
        ("actors/loop.py", "import viewer", "viewer"),
        ("actors/envs/__init__.py", "register(f'viewer.terminal.rendering:{kind}')", "viewer"),
        ("replay/ring.py", "FACTORY = 'learner.training:Learner.of_run'", "learner"),
        ("viewer/show.py", "from benchmarks.report import publish", "benchmarks"),
        ("replay/server.py", "import zenoh", "zenoh"),
        ("common/transport/requests.py", "from zenoh.handlers import Callback", "zenoh"),
        ("actors/envs/robot.py", "import pybullet", "pybullet"),
        ("learner/training.py", "from tensorboard.summary import writer", "tensorboard"),
    ],
)
def test_a_broken_arrow_is_seen(path: str, source: str, package: str) -> None:
    assert against_the_rules(path, source) == {(path, package)}


@pytest.mark.parametrize(
    ("path", "source"),
    [
        (
            "common/transport/zenoh_transport.py",
            "import zenoh, common.errors",
        ),
        (REGISTRY, "Entry('ale', 'actors.envs.ale:AtariEnv.of_run')"),
        ("replay/ring.py", "'learner.training: the loop'"),
        ("actors/robots/nao/engine.py", "def f():\n    import pybullet"),
        ("learner/training.py", "from replay.interface import Replay\nfrom . import clock"),
        ("benchmarks/transport_client.py", "import actors, learner, replay, viewer, common"),
        ("viewer/show.py", "from actors.envs import make_env\nimport numpy, rich"),
    ],
)
def test_an_arrow_that_is_kept_is_none_of_its_business(path: str, source: str) -> None:
    assert against_the_rules(path, source) == set()


def test_every_package_of_the_product_is_looked_at() -> None:
    packages = {path.parent.name for path in ROOT.glob("*/__init__.py")} - {"tests"}
    assert packages == set(ARROWS)
    assert len(list(sources())) > 100


def test_what_the_page_names_inside_a_class_is_there() -> None:
    code = [text for _, text in sources()]
    named = re.findall(r"`(\w+)\.(_\w+)`", (ROOT / "docs" / "architecture.md").read_text())
    assert named
    for kind, name in named:
        there = re.compile(rf"class {kind}\b.*(def {name}\(|self\.{name} = )", re.DOTALL)
        assert any(there.search(text) for text in code), f"{kind}.{name}"


@pytest.mark.parametrize(
    "program", ["actors", "deploy", "learner", "learner/evaluation", "replay", "viewer"]
)
def test_each_program_begins_with_the_same_lines(program: str) -> None:
    # They come before any import, so no module can hold them.
    here = "/..".join(["{__file__}", *("" for _ in program.split("/")), ""])
    text = (ROOT / program / "__main__.py").read_text(encoding="utf-8")
    assert (
        f'''
if __name__ == "__main__":
    import os
    import sys

    # A working directory that does not hold this package may hold another `common`.
    if not sys.flags.safe_path and sys.path[0] != os.path.abspath(f"{here}"):
        del sys.path[0]
        os.environ["PYTHONSAFEPATH"] = "1"  # for the programs that this one starts

    from common.process.lifeline import leave_at_interrupt'''
        in text
    )
