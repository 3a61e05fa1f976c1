"""`ale-robot policies`: lists the shipped policies; `push` and `pull` share them through a model
hub.

At the hub a policy is three files: the weights as safetensors; our card as JSON, with the SHA-256
of the weights; and README.md, the model card for people and for the hub. Address and login are
settings of huggingface_hub: ``HF_ENDPOINT``, ``HF_TOKEN``, ``hf auth login``.
"""

import hashlib
import json
import re
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from ale_robot.commands import POLICY_COMMANDS
from ale_robot.model_card import model_card
from ale_robot.policies import list_policies
from common.atomic_file import write_atomically, write_json
from common.checked import NAME
from common.command_line.parser import parse
from common.errors import InputError
from common.exit_codes import UNREACHABLE
from common.process.extras import check_extra, extra_for
from common.regular_file import read_file
from common.run.origin import find_weights

MAX_WEIGHTS = 64 * 2**20
MAX_CARD = 2**20
"""Maximum size of a fetched file, bytes."""


@dataclass(frozen=True)
class Push:
    """Upload a policy and its card to a repository of a model hub."""

    policy: tyro.conf.Positional[str]
    """Policy to upload: the name of a shipped one, or a file that `python -m learner.publish`
    made."""
    repository: tyro.conf.Positional[str]
    """Repository at the hub, OWNER/NAME; created if it does not exist."""
    private: bool = False
    """Make a created repository visible to its owner only."""

    def run(self) -> None:
        """Uploads the three files in one commit.

        Raises:
            InputError: the policy has no card, or the hub refuses it.
        """
        check_extra("a model hub", "hub")
        from ale_robot.policy import load_policy  # loads PyTorch, which listing does not need

        weights = find_weights(self.policy)
        card, content = _card_of(weights), read_file(weights)
        card["sha256"] = hashlib.sha256(content).hexdigest()
        config = load_policy(weights).config  # what cannot be loaded must not be pushed
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            (folder / weights.name).write_bytes(content)
            write_json(folder / f"{weights.stem}.json", card)
            told = model_card(weights.stem, card, config, self.repository)
            (folder / "README.md").write_text(told)
            _ask("create_repo", self.repository, private=self.private, exist_ok=True)
            message = f"{weights.stem}, {card['agent_steps']:,} agent steps"
            _ask("upload_folder", self.repository, folder_path=folder, commit_message=message)
        print(f"pushed {weights.stem} to {self.repository}")


@dataclass(frozen=True)
class Pull:
    """Fetch a policy from a model hub, and check it."""

    repository: tyro.conf.Positional[str]
    """Repository at the hub, OWNER/NAME."""
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path()
    """Folder for weights and card."""
    revision: str = "main"
    """Branch, tag or commit of the repository."""

    def run(self) -> None:
        """Writes NAME.safetensors and NAME.json.

        Raises:
            InputError: the repository has no policy, the policy does not match its card, or a file
                of that name exists already.
        """
        check_extra("a model hub", "hub")
        from ale_robot.policy import load_policy

        with tempfile.TemporaryDirectory() as temporary:
            info = _ask("model_info", self.repository, revision=self.revision, files_metadata=True)
            sizes = {file.rfilename: file.size for file in info.siblings or ()}
            weights, card = names = _pair(self.repository, sizes)
            for name in names:
                if (self.output / name).exists():
                    raise InputError(
                        f"{self.output / name} already exists: choose another folder with -o."
                    )
            for name, most in zip(names, (MAX_WEIGHTS, MAX_CARD), strict=True):
                if not 0 < (sizes[name] or 0) <= most:
                    raise InputError(
                        f"{name} of {self.repository} has {sizes[name]} bytes: a policy has at "
                        f"most {most:,} there."
                    )
                # The commit whose sizes were checked, even if the branch has moved since.
                of_commit = {"filename": name, "revision": info.sha}
                _ask("hf_hub_download", self.repository, **of_commit, local_dir=temporary)
            fetched = Path(temporary) / weights
            content = read_file(fetched, MAX_WEIGHTS)
            told = _card_of(fetched, f"{weights} of {self.repository}")
            if told.get("sha256") != hashlib.sha256(content).hexdigest():
                raise InputError(
                    f"{weights} of {self.repository} does not match its card: pull again, or ask "
                    "whoever pushed it."
                )
            load_policy(fetched)
            self.output.mkdir(parents=True, exist_ok=True)
            write_atomically(self.output / weights, content)
            write_atomically(self.output / card, read_file(fetched.with_suffix(".json")))
        print(f"pulled {self.output / weights}: ale-robot watch {self.output / weights}")


def _pair(repository: str, files: dict[str, Any]) -> tuple[str, str]:
    """Returns the file names of weights and card; other files of the repository are ignored."""
    stems = [
        name.removesuffix(".safetensors")
        for name in files
        if name.endswith(".safetensors") and f"{name.removesuffix('.safetensors')}.json" in files
    ]
    if len(stems) != 1 or not re.fullmatch(NAME, stems[0]):
        raise InputError(
            f"{repository} holds no policy of ale-robot: it needs exactly one NAME.safetensors "
            "with its NAME.json."
        )
    return f"{stems[0]}.safetensors", f"{stems[0]}.json"


def _card_of(weights: Path, called: str = "") -> dict[str, Any]:
    """Returns the card beside ``weights``, which people know as ``called``.

    Raises:
        InputError: there is none, or publishing was interrupted before the evaluation.
    """
    lacks = "card beside it"
    try:
        card = json.loads(read_file(weights.with_suffix(".json"), MAX_CARD))
        if {"config", "agent_steps"} <= card.keys():
            if "evaluation" in card:
                return dict(card)
            lacks = "scores in its card"
    except (OSError, ValueError, AttributeError, RecursionError):
        pass
    raise InputError(
        f"{called or weights} has no {lacks}: make it with `ale-robot publish RUN -o NAME`."
    )


def _ask(what: str, repository: str, **arguments: Any) -> Any:
    """Calls the method ``what`` of huggingface_hub's API, and returns its result.

    Raises:
        InputError: huggingface_hub is not installed, the name is not a repository's, or the hub is
            away or refuses.
    """
    with extra_for("a model hub", "hub"):
        from huggingface_hub import HfApi
    owner, _, name = repository.partition("/")
    if not (re.fullmatch(NAME, owner) and re.fullmatch(NAME, name)):
        raise InputError(f"{repository} names no repository: write OWNER/NAME.")
    try:
        return getattr(HfApi(), what)(repo_id=repository, **arguments)
    except Exception as error:  # its own errors, and those of any HTTP client that it uses
        reason = str(error).strip().partition("\n")[0].rstrip(".")
        if isinstance(error, ConnectionError | TimeoutError) or "Connect" in type(error).__name__:
            told = f"the hub cannot be reached ({reason}): see HF_ENDPOINT and your network."
            raise InputError(told, UNREACHABLE) from None
        raise InputError(f"the hub does not serve {repository}: {reason}.") from None


def main() -> None:
    """Lists the shipped policies, or pushes or pulls one."""
    if not sys.argv[1:]:
        list_policies()
        return
    if (name := sys.argv[1]) not in POLICY_COMMANDS and not name.startswith("-"):
        raise InputError(
            f"`ale-robot policies` has no command {name!r}: omit it to list the shipped policies, "
            "or choose push or pull."
        )
    commands: Any = Push | Pull
    parse(commands, "policies", sys.argv[1:]).run()
