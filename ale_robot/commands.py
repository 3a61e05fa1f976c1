"""The commands of `ale-robot`: the program behind each, and its short help.

`--help` prints the short help at once. `--help-all` loads the program, whose own help lists every
flag.
"""

import textwrap

from common.games import GAMES

PROGRAMS: dict[str, tuple[str, ...]] = {
    "watch": ("viewer.__main__", "watch"),
    "train": ("learner.__main__", "--local"),
    "join": ("actors.__main__",),
    "replay": ("replay.__main__",),
    "launch": ("deploy.__main__",),
    "status": ("learner.status",),
    "runs": ("learner.runs",),
    "play": ("viewer.__main__", "play"),
    "human": ("viewer.__main__", "human"),
    "record": ("viewer.__main__", "record"),
    "check": ("viewer.__main__", "check"),
    "film": ("viewer.__main__", "film"),
    "evaluate": ("learner.evaluation.__main__",),
    "plot": ("learner.figures.plot",),
    "publish": ("learner.publish",),
    "backup": ("learner.backup",),
    "policies": ("ale_robot.hub",),
}
"""Programs by command: the module whose ``main`` is called, and the arguments that come before the
user's."""
MEANT = {
    "list": "`ale-robot policies` lists the policies, `ale-robot --help-all` the games.",
    "version": "`ale-robot --version` tells it.",
}
"""What serves instead, by the words that are commands of other programs."""
EXTENSIBLE = {"train", "replay", "evaluate", "watch", "play", "human", "record", "check", "film"}
"""Commands whose flags choose an environment, a robot or an algorithm."""

POLICY_COMMANDS = ("push", "pull")
"""Commands of `policies`, each with a help of its own."""

HELP = {
    "watch": """\
Watch a trained robot play in this terminal.

  ale-robot watch                                  the shipped robot at Pong
  ale-robot watch RUN                              the newest network of a run
  ale-robot watch ale_pong                         the emulator, without a robot
  ale-robot watch robot_pong_robust --camera.noise 20   a camera with noise

  NAME|FILE            network: robot_pong, ale_pong, a run or a file
  --game GAME          game to play, such as breakout
  --epsilon SHARE      share of random actions, 0 to 1
  --games N            number of games; 0, the default, plays until you press q
  --seed N             seed of the games
  --camera.*, --play.*      another camera, light, screen, hands or chance
""",
    "train": """\
Train a robot on this machine until Ctrl-C.

  ale-robot train --run first                      NAO learns Pong
  ale-robot train --run first --resume             continue that run
  ale-robot train --env ale --game breakout        the emulator, without a robot
  ale-robot train --config run.toml --seed 2       flags in a file; --seed wins

  --run NAME           name of the run and of its folder in runs/
  --env robot|ale      camera and hands (default), or the emulator alone
  --game GAME          pong (default), breakout, …; list: ale-robot --help-all
  --preset NAME        robot or frugal; fast (usual without a robot) or paper
  --actors N           number of robots that play at the same time (1)
  --evaluators N       number of evaluators, which play tests (1); 0 is faster
  --steps N            agent steps at which to end; 400,000 take 14 to 90 min
  --initial NAME|FILE  network to start from, with its layers
  --demonstrations FOLDER   recorded games with which the replay starts
  --play.vector        commands, keys and joints as input, beside the frames
  --no-sync            real time, instead of as fast as the machine allows
  --web ADDRESS        address of the run's web page, such as 127.0.0.1:8080
  --no-local           replay and learner only; actors join from elsewhere
  --listen ADDRESS     address for actors; tcp/0.0.0.0:7447 admits other hosts
""",
    "join": """\
Join a run as an actor, from another terminal or machine.

  ale-robot join                                   a run on this machine
  ale-robot join --connect tcp/HOST:7447           a run on another machine
  ale-robot join --evaluator                       play the tests of epochs

  --connect ADDRESS    address of the run's learner or replay
  --certificates DIR   folder of certificates, for a tls/ address
  --name NAME          name of this actor, if DIR has several certificates
  --run NAME           name of the run, if the address serves several
  --envs N             number of environments in this process
  --no-sync            real time, instead of as fast as the machine allows
  --patience SECONDS   time to wait for the run; inf waits for ever
""",
    "replay": """\
Serve a run's replay from a process of its own.

  ale-robot replay --run pong
  ale-robot train --no-local --run pong --connect tcp/127.0.0.1:7447

  --run NAME           name of the run
  --listen ADDRESS     address to which learner and actors connect
  --resume             continue with the stored steps
""",
    "launch": """\
Launch a run on Slurm, Kubernetes, Compose or Ray.

  ale-robot launch slurm --actors 8 --submit       the robot learns Pong
  ale-robot launch slurm --gpus 1 --time 04:00:00 -- --game breakout
  ale-robot launch kubernetes --image HOST/ale-robot:1
  ale-robot launch ray --run pong --actors 8       on a Ray cluster; repeat with
                                                   another number to scale it

  -- FLAGS             flags of ale-robot train
  --run NAME           name of the run and of its folder in runs/
  --actors N           number of robots that play at the same time
  --evaluators N       number of evaluators, which play the tests of epochs
  --submit             submit the Slurm jobs, instead of only writing them
  --address HOST:PORT  address of the Ray cluster
  --stop               end the run on Ray, with a checkpoint
""",
    "status": """\
Show how a run is doing, on this machine or another.

  ale-robot status                                 a run at work on this machine
  ale-robot status RUN                             how far a run of yours came
  ale-robot status --connect tcp/HOST:7447 --json

  RUN                  run of this machine, by its name or folder
  --connect ADDRESS    address of the run's learner or replay
  --certificates DIR   folder of a learner's certificates, for a tls/ address
  --run NAME           name of the run, if the address serves several
  --json               JSON instead of a table

  exit code: 0 healthy, 1 something is red, 4 nobody answers, or it has ended
""",
    "runs": """\
List the runs of a folder, how far they came, and who is at work.

  ale-robot runs                                   those in runs/
  ale-robot runs /mnt/backup --json

  FOLDER               folder that holds the runs
  --json               JSON with all figures
""",
    "play": """\
Play whole games and print their scores.

  ale-robot play robot_pong --games 5
  ale-robot play --viewer rerun                    the room in 3-D, with plots
  ale-robot play --save game.rrd                   the same, as a file

  NAME|FILE            network that plays; actions are random without one
  --env, --game, --robot, --seed    what to play
  --epsilon SHARE      share of random actions, 0 to 1
  --games N            number of games
  --seconds S          seconds of play, instead of whole games
  --viewer rerun       Rerun's viewer: a window, or a web page without a display
  --save FILE.rrd      recording for Rerun's viewer
  --no-sync            real time, instead of as fast as the machine allows

  Rerun needs pip install 'ale-robot[viz]'.
""",
    "human": """\
Play yourself, through the robot's hands: arrow keys, space, q.

  ale-robot human --game breakout
  ale-robot human --robot robotroller
  ale-robot human --play.actuation-latency 12      with hands 200 ms later
  ale-robot human --record FOLDER --play.minimal-actions   for demonstrations

  --game GAME          game to play, such as breakout
  --robot NAME         robot: nao or robotroller
  --camera.*, --play.*      another camera, light, screen, hands or chance
  --record FOLDER      folder for a LeRobot dataset of your games

  --record needs pip install 'ale-robot[record]'.
""",
    "record": """\
Record a network's games as a LeRobot dataset.

  ale-robot record robot_pong_pixels -o FOLDER --minutes 10
  ale-robot record ale_pong -o FOLDER --games 3
  ale-robot train --demonstrations FOLDER          start a run with them

  NAME|FILE            network: robot_pong, ale_pong, a run or a file
  -o FOLDER            folder of the recording, which must not exist yet
  --games N            number of whole games
  --minutes M          minutes of game time, instead of whole games
  --env, --game, --robot, --seed    what to play
  --epsilon SHARE      share of random actions, 0 to 1
  --no-sync            real time, instead of as fast as the machine allows

  Recordings need pip install 'ale-robot[record]'.
""",
    "check": """\
Check a robot's sight and touch, and write a picture.

  ale-robot check
  ale-robot check --robot robotroller -o arm.png

  --env, --game, --robot, --seed    what to check
  -o FILE.png          picture; check.png by default

  exit code: 0 healthy, 1 a health check is red
""",
    "film": """\
Film a game, or a run's progress: room, camera, hands and network.

  ale-robot film                                   writes film.mp4
  ale-robot film ale_pong --seconds 20 --video short.gif
  ale-robot film runs/NAME/snapshots/best.safetensors --video best.mp4
  ale-robot film RUN                               each epoch of a run that was
                                                   trained with --keep-snapshots

  NAME|FILE            network that plays; a run is filmed by its epochs
  --camera.*, --play.*      another camera, light, screen, hands or chance
  --video FILE         film: .mp4, or .gif of at most 120 s
  --seconds S          seconds of play: by default a whole game, or, of a run,
                       8 for each epoch
""",
    "evaluate": """\
Evaluate a network over whole games, in several processes.

  ale-robot evaluate robot_pong
  ale-robot evaluate RUN                           the newest network of a run
  ale-robot evaluate runs/NAME/snapshots/best.safetensors --headline --json FILE
  ale-robot evaluate robot_pong --camera.noise 8   under camera noise

  NAME|FILE            network: a shipped policy, a run or a file
  --games N            number of games (30)
  --headline           two more scores: 5 % random actions, and sticky actions
  --epsilon SHARE      share of random actions, 0 to 1 (0.001)
  --processes N        games at the same time; by default one on each core
  --json FILE          file for the results; replaces earlier results alone
  --no-sync            real time, instead of as fast as the machine allows
""",
    "plot": """\
Plot runs: reward and mean max-Q by epoch.

  ale-robot plot A B -o figure.png
  ale-robot plot A --figure progress --phase train -o figure.png
  ale-robot plot evaluation.json --figure histogram -o figure.png

  --figure NAME        epochs, progress (by steps and time) or histogram
  --phase NAME         test or train
  -o FILE              picture: .png, .svg or .pdf

  A run needs one complete epoch; before that, use --web or TensorBoard.
""",
    "publish": """\
Publish a run's network as a policy, with a card of its scores.

  ale-robot publish RUN -o policies/mine           its last weights
  ale-robot publish RUN --best -o policies/mine    those of its best test
  ale-robot watch policies/mine.safetensors

  RUN                  run, by its name or folder
  -o NAME              path of both files, without suffix
  --best               the weights of the best test instead of the last ones
  --replace            replace the policy that is there
  --games N            games of each of the card's three evaluations (30)
""",
    "backup": """\
Copy a run, even while it is training, to continue it elsewhere.

  ale-robot backup NAME -o /mnt/backup/NAME
  ale-robot train --runs /mnt/backup --run NAME --resume       continue the copy

  -o FOLDER            folder of the copy, which must not exist yet
""",
    "policies": """\
List the shipped policies; share policies through a model hub.

  ale-robot policies                               list the shipped policies
  ale-robot watch ale_pong                         watch one of them
  ale-robot policies pull OWNER/NAME -o FOLDER     fetch one from the hub
  ale-robot policies push robot_pong OWNER/NAME    upload one to the hub

  pull and push need pip install 'ale-robot[hub]'.
""",
}
"""Short help by command: what it does in one line, examples, and the most common flags. With the
last lines of `help_of` it fits one screen of 24 lines and 80 columns."""


def help_of(name: str) -> str:
    """Returns what `ale-robot NAME --help` prints."""
    more = f"\nAll flags: ale-robot {name} --help-all"
    if name in EXTENSIBLE:
        more += " (--env NAME adds its own)"
    return HELP[name] + more


def overview(*, everything: bool) -> str:
    """Returns the list of commands; with ``everything``, also the list of games."""
    lines = [
        "A simulated robot learns Atari games through its camera and its hands.",
        "Begin with `ale-robot watch`, then `ale-robot train`.",
        "",
        *(f"  {name:<10} {text.splitlines()[0]}" for name, text in HELP.items()),
        "",
        "  ale-robot COMMAND --help        its usual flags; --help-all: all flags",
    ]
    if everything:
        games = textwrap.fill(", ".join(GAMES), 78, initial_indent="  ", subsequent_indent="  ")
        return "\n".join([*lines, "", f"The {len(GAMES)} games of --game:", games])
    return "\n".join(
        [
            *lines,
            f"  ale-robot --help-all            the {len(GAMES)} games; --version: its version",
        ]
    )
