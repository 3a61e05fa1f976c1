"""`ale-robot`: which program each command is, and what its help says."""

import json
import re
import signal
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import pytest

import ale_robot.__main__ as command_line
from ale_robot.commands import EXTENSIBLE, HELP, PROGRAMS, overview
from common.errors import InputError
from common.registry import ENVIRONMENTS, Environment
from common.run.origin import SHIPPED
from tests.extending.whole_run import added
from tests.paths import ROOT


def run(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int | None:
    monkeypatch.setattr(sys, "argv", ["ale-robot", *arguments])
    return command_line.run()


@pytest.mark.parametrize("name", PROGRAMS)
def test_the_short_help_fits_a_screen(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, name, "--games", "3", "--help") == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) <= 23
    assert max(map(len, lines)) <= 80
    extended = " (--env NAME adds its own)" if name in EXTENSIBLE else ""
    assert lines[-1] == f"All flags: ale-robot {name} --help-all{extended}"
    assert any(line.startswith(f"  ale-robot {name}") for line in lines)


@pytest.mark.parametrize("name", PROGRAMS)
def test_every_flag_of_the_short_help_is_one_of_the_program(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    if name == "plot":
        pytest.importorskip("matplotlib")
    listed = [line for line in HELP[name].splitlines() if line.startswith("  -")]
    told = set(re.findall(r"(?<!\S)--?[a-z][\w.-]*", "\n".join(listed)))
    with pytest.raises(SystemExit) as left:
        run(monkeypatch, name, "--help-all")
    assert left.value.code == 0
    known = set(re.findall(r"(?<![\w-])--?[a-z][\w.-]*", capsys.readouterr().out))
    groups = {each for each in told if each.endswith(".")}  # --play.* stands for all of them
    assert told - {"--help-all"} - groups <= known
    assert all(any(flag.startswith(group) for flag in known) for group in groups)


@dataclass(frozen=True)
class Settings:
    lamps: int = 3
    """Number of lamps."""


@pytest.mark.parametrize("name", sorted(EXTENSIBLE))
def test_all_flags_beside_an_extension_include_its_settings(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    entry = Environment("lit", "nowhere:lit", lambda config: 1, settings=Settings)
    with added(ENVIRONMENTS, entry), pytest.raises(SystemExit):
        run(monkeypatch, name, "--env", "lit", "--help-all")
    said = capsys.readouterr().out
    assert "Settings of lit, each for --play.env-settings 'NAME=VALUE ...':\n" in said
    assert "\n  lamps=3 (integer): Number of lamps.\n" in said


def test_a_command_is_its_program_with_its_flags_before_the_users(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    called = []

    def main() -> int:
        called.append([*sys.argv])
        return 3

    for module in ("learner.__main__", "learner.evaluation.__main__"):
        monkeypatch.setitem(sys.modules, module, SimpleNamespace(main=main))
    assert run(monkeypatch, "train", "--seed", "2") == 3
    assert run(monkeypatch, "evaluate", "robot_pong") == 3
    assert run(monkeypatch, "train", "--env", "ale", "--help-all") == 3
    assert called == [
        ["ale-robot train", "--local", "--seed", "2"],
        ["ale-robot evaluate", "robot_pong"],
        ["ale-robot train", "--help", "--env", "ale"],  # the help depends on the flags
    ]


def test_programs_that_compute_nothing_or_tell_only_their_flags_load_no_pytorch() -> None:
    modules = (
        *("actors.__main__", "ale_robot.hub", "deploy.__main__", "learner.__main__"),
        *("learner.evaluation.__main__", "learner.status", "viewer.__main__"),
    )
    code = f"import sys, {', '.join(modules)}; sys.exit('torch' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)


def test_a_person_plays_without_pytorch() -> None:
    code = """
import sys
import viewer.__main__
from actors.envs.robot import RobotEnv
from viewer.human import REAL_TIME, Human

def run(human, stop):
    env = RobotEnv.of_run(human.config(), REAL_TIME, training=False)
    env.reset(seed=1)
    env.step(0)
    env.close()
    sys.exit('torch' in sys.modules)

Human.run = run
sys.argv[1:] = ["human"]
viewer.__main__.main()
"""
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)


def test_what_is_no_command_is_told_with_those_that_are(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match=r"no command 'wach': did you mean watch\?"):
        run(monkeypatch, "wach")
    with pytest.raises(InputError, match="no command 'xyzzy': choose one of watch, train"):
        run(monkeypatch, "xyzzy")
    with pytest.raises(InputError, match="no command 'list': `ale-robot policies` lists"):
        run(monkeypatch, "list")


def test_an_evaluation_without_a_network_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    for arguments in ([], ["--games", "2"]):
        with pytest.raises(InputError, match=r"^FILE is missing \(Network to evaluate"):
            run(monkeypatch, "evaluate", *arguments)


def test_a_package_that_is_missing_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(PROGRAMS, "plot", ("nobodys",))
    with pytest.raises(InputError, match=r"needs the package nobodys.*: pip install nobodys"):
        run(monkeypatch, "plot", "a")


def test_a_figure_without_matplotlib_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in [each for each in sys.modules if each.startswith("learner.figures.")]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(InputError, match=r"matplotlib.*: pip install 'ale-robot\[plot\]'\.$"):
        run(monkeypatch, "plot", "a")


def test_help_is_a_command_too(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for words, flags in ((("help",), ("--help",)), (("help", "train"), ("train", "--help"))):
        assert run(monkeypatch, *words) == 0
        said = capsys.readouterr().out
        assert run(monkeypatch, *flags) == 0
        assert capsys.readouterr().out == said
    with pytest.raises(InputError, match="there is no command 'trian': did you mean train"):
        run(monkeypatch, "help", "trian")


def test_the_overview_fits_a_screen_and_names_the_games_on_request(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch) == run(monkeypatch, "--help") == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) <= 2 * 23
    assert max(map(len, lines)) <= 80
    assert "space_invaders" not in overview(everything=False)
    assert "space_invaders" in overview(everything=True)


def test_the_version_is_told(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, "--version") == 0
    assert re.fullmatch(r"ale-robot \S+\n", capsys.readouterr().out)


def test_the_shipped_policies_are_listed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "60")
    assert not run(monkeypatch, "policies")
    said = capsys.readouterr().out
    scores = r"20\.70 +15\.23 +8\.50"
    assert re.search(rf"robot_pong +pong +robot vector +{scores}", said)
    assert re.search(r"robot_pong_robust .* 19\.8/19\.2 *\n", said)  # as README has it
    assert re.search(r"robot_pong_sticky .* −13\.5/−21\.0 *\n", said)
    assert re.search(r"ale_pong .* 15\.13 *\n", said)
    assert re.search(r"ale_kangaroo +kangaroo +ale +frames +5,380 +2,713 +5,260 *\n", said)
    assert re.search(r"robot_breakout +breakout +robot frames +12\.00 +12\.77 +9\.23 *\n", said)
    assert "Watch one: ale-robot watch NAME\n" in said
    assert max(map(len, said.splitlines())) <= 80
    with pytest.raises(InputError, match=r"no command 'show': omit it to list"):
        run(monkeypatch, "policies", "show")


def test_the_help_of_several_commands_has_no_words_of_pythons(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        run(monkeypatch, "policies", "--help-all")
    said = capsys.readouterr().out
    assert "PEP 604" not in said
    assert "Exit codes:" in said


@pytest.mark.parametrize("flag", ["-h", "--help", "--help-all"])
@pytest.mark.parametrize(("name", "own"), [("push", "--private"), ("pull", "--revision")])
def test_a_command_of_the_policies_has_its_own_help(
    name: str,
    own: str,
    flag: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(SystemExit) as left:
        run(monkeypatch, "policies", name, flag)
    assert left.value.code == 0
    said = capsys.readouterr().out
    assert said.startswith(f"usage: ale-robot policies {name} ")
    assert own in said


def test_a_card_without_an_evaluation_or_with_one_of_a_former_version_is_listed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    card = json.loads((SHIPPED / "ale_pong.json").read_bytes())
    del card["evaluation"]  # as a publishing that is stopped leaves it
    (tmp_path / "stopped.json").write_text(json.dumps(card))
    card["evaluation"] = {"epsilon": 0.05, "mean": 12.5}
    (tmp_path / "former.json").write_text(json.dumps(card))
    monkeypatch.setattr("ale_robot.policies.SHIPPED", tmp_path)
    assert not run(monkeypatch, "policies")
    said = capsys.readouterr().out
    assert re.search(r"former +pong +ale +frames +12\.50", said)
    assert re.search(r"stopped +pong +ale +frames *\n", said)


@pytest.mark.parametrize(
    ("name", "status", "told"),
    [("ale-robot", 130, ""), ("mine", -signal.SIGINT, "KeyboardInterrupt")],
)
def test_an_interrupt_while_it_is_imported_ends_the_command_without_a_traceback(
    tmp_path: Path, name: str, status: int, told: str
) -> None:
    program = tmp_path / name
    program.write_text(
        f"""
import os, signal, sys

signal.signal(signal.SIGINT, signal.default_int_handler)  # whatever a shell has made of it

class Interrupted:
    def find_spec(self, name, *_):
        if name == "gymnasium":
            os.kill(os.getpid(), signal.SIGINT)

sys.path.insert(0, {str(ROOT)!r})
sys.meta_path.insert(0, Interrupted())
import ale_robot
"""
    )
    ended = subprocess.run([sys.executable, program], capture_output=True, text=True, check=False)
    assert ended.returncode == status
    assert ended.stderr.strip()[-17:] == told
