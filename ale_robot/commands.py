"""The commands of `ale-robot`: the program behind each, and its short help.

`--help` shows this text at once; `--help-all` loads the program, whose own help has every flag.
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
    "play": ("viewer.__main__", "play"),
    "human": ("viewer.__main__", "human"),
    "record": ("viewer.__main__", "record"),
    "check": ("viewer.__main__", "check"),
    "film": ("viewer.__main__", "film"),
    "evaluate": ("learner.__main__", "--evaluate"),
    "plot": ("learner.figures.plot",),
    "backup": ("learner.backup",),
    "policies": ("ale_robot.hub",),
}
"""By the command's name, the module whose ``main`` it calls, and what comes before the user's
arguments."""
LOADING = {"watch", "play", "record", "check", "film", "evaluate"}
"""Commands that say at a terminal that they load PyTorch; training says it anywhere."""

SHOWING = ("watch", "play")
"""Commands that take a network also without its flag, as `evaluate` does."""

HELP = {
    "watch": """\
Watch a trained robot play in this terminal.

  ale-robot watch                                  the shipped robot at Pong
  ale-robot watch runs/NAME                        newest network of a run
  ale-robot watch ale_pong --env ale               the emulator, without a robot

  NAME|FILE            network that plays: robot_pong, ale_pong, a run or a file
  --game GAME          game, such as breakout
  --epsilon SHARE      share of random actions, 0 to 1
  --games N            number of whole games; 0, the default, plays until q
  --seed N             seed of the games
""",
    "train": """\
Train a robot on this machine until Ctrl-C.

  ale-robot train --run first                      NAO learns Pong
  ale-robot train --run first --resume             go on
  ale-robot train --env ale --game breakout        the emulator, without a robot
  ale-robot train --config run.toml --seed 2       a file of flags; flags win

  --run NAME           name of the run, a folder below runs/
  --env robot|ale      camera and hands (the default), or the emulator alone
  --game GAME          pong, the default, breakout, …; all: ale-robot --help-all
  --preset NAME        settings to start from: robot (the default), fast, paper
  --actors N           number of robots that play at a time; 1 by default
  --steps N            agent steps after which it ends; 500,000 take an hour
  --seed N             seed of weights, minibatches and games
  --initial NAME|FILE  network to begin with, instead of a fresh one
  --demonstrations FOLDER   recorded games with which the replay begins
  --play.vector        commands, keys and joints too, beside the camera's frames
  --no-sync            robots in real time
  --web ADDRESS        page of the run for a browser, such as 127.0.0.1:8080
  --no-local           replay and learner only; actors join from elsewhere
  --listen ADDRESS     where they find it; tcp/0.0.0.0:7447 lets other hosts in
""",
    "join": """\
Join a run as an actor, from another terminal or machine.

  ale-robot join                                   a run on this machine
  ale-robot join --connect tcp/HOST:7447           a run elsewhere
  ale-robot join --evaluator                       play the tests of epochs

  --connect ADDRESS    address of the run's learner or replay
  --certificates DIR   certificates, where the address begins with tls/
  --name NAME          name of this actor, where the folder has several names
  --run NAME           name of the run, where an address serves several
  --envs N             number of environments in this process
  --no-sync            play in real time
  --patience SECONDS   time to wait for the run; inf for ever
""",
    "replay": """\
Serve the replay of a run as a process of its own.

  ale-robot replay --run pong
  ale-robot train --no-local --run pong --connect tcp/127.0.0.1:7447

  --run NAME           name of the run
  --listen ADDRESS     address where learner and actors find it
  --resume             go on with what is stored
""",
    "launch": """\
Launch a run on Slurm, Kubernetes, Compose or Ray.

  ale-robot launch slurm --actors 8 --submit       the robot learns Pong
  ale-robot launch slurm --gpus 1 --time 04:00:00 -- --game breakout
  ale-robot launch kubernetes --image HOST/ale-robot:1
  ale-robot launch ray --run pong --actors 8       on a Ray cluster; again, with
                                                   another number, to scale it

  -- FLAGS             flags of ale-robot train
  --run NAME           name of the run, a folder below runs/
  --actors N           number of robots that play at a time
  --evaluators N       number of those that play the tests of epochs
  --submit             submit the jobs of Slurm too, rather than only write them
  --address HOST:PORT  address of the Ray cluster
  --stop               end the run on Ray, with a checkpoint
""",
    "status": """\
Tell how a run does, wherever it is; the exit code says it too.

  ale-robot status                                 a run on this machine
  ale-robot status --connect tcp/HOST:7447 --json

  --connect ADDRESS    address of the run's learner or replay
  --certificates DIR   a learner's certificates, for a tls/ address
  --run NAME           name of the run, where an address serves several
  --json               JSON instead of a table

  exit code: 0 healthy, 1 something is red, 4 nobody answers
""",
    "play": """\
Play whole games, and print their scores.

  ale-robot play robot_pong --games 5
  ale-robot play --viewer rerun                    the room in 3-D, with figures
  ale-robot play --save game.rrd                   the same as a file

  NAME|FILE            network that plays; random actions without
  --env, --game, --robot, --seed    what is played
  --epsilon SHARE      share of random actions, 0 to 1
  --games N            number of games
  --seconds S          seconds of play, instead of whole games
  --viewer rerun       Rerun's viewer: a window, or a page without a display
  --save FILE.rrd      recording for that viewer
  --no-sync            real time

  Rerun needs pip install 'ale-robot[viz]'.
""",
    "human": """\
Play yourself, through the robot's hands: arrow keys, space, q.

  ale-robot human --game breakout
  ale-robot human --robot robotroller
  ale-robot human --record FOLDER                  for `train --demonstrations`

  --game GAME          game, such as breakout
  --robot NAME         robot: nao or robotroller
  --record FOLDER      LeRobot dataset of what is played

  --record needs pip install 'ale-robot[record]'.
""",
    "record": """\
Record a network's games as a LeRobot dataset.

  ale-robot record robot_pong -o FOLDER --minutes 10
  ale-robot record ale_pong -o FOLDER --games 3
  ale-robot train --demonstrations FOLDER          begin with them

  NAME|FILE            network that plays: robot_pong, ale_pong, a run or a file
  -o FOLDER            folder of the recording, which must not exist yet
  --games N            number of whole games
  --minutes M          minutes of game time, instead of whole games
  --env, --game, --robot, --seed    what is played
  --epsilon SHARE      share of random actions, 0 to 1
  --no-sync            real time

  Recordings need pip install 'ale-robot[record]'.
""",
    "check": """\
Check a robot's sight and touch, and write a picture.

  ale-robot check
  ale-robot check --robot robotroller -o arm.png

  --env, --game, --robot, --seed    what is checked
  -o FILE.png          picture; check.png by default

  exit code: 0 healthy, 1 a health check is red
""",
    "film": """\
Film a game, or how a run learned: room, camera, hands and network.

  ale-robot film                                   writes film.mp4
  ale-robot film ale_pong --seconds 20 --video short.gif
  ale-robot film runs/NAME/snapshots/best.safetensors --video best.mp4
  ale-robot film runs/NAME                         each epoch of a run that was
                                                   trained with --keep-snapshots

  NAME|FILE            network that plays; a run's folder films its epochs
  --video FILE         film: .mp4, or .gif of at most 120 s
  --seconds S          seconds of play, by default a whole game; of a run 8 for
                       each epoch
""",
    "evaluate": """\
Test a network by whole games, in several processes.

  ale-robot evaluate robot_pong
  ale-robot evaluate runs/NAME/snapshots/best.safetensors --headline --json FILE
  ale-robot evaluate robot_pong --camera.noise 8   in another world

  NAME|FILE            network that plays, as these: a policy, a run or a file
  --games N            number of games
  --headline           also with 5 % random actions, and with sticky actions
  --epsilon SHARE      share of random actions, 0 to 1
  --processes N        games played at a time
  --json FILE          file of the results
  --no-sync            real time
""",
    "plot": """\
Draw runs: reward and mean max-Q by epoch.

  ale-robot plot runs/A runs/B -o figure.png
  ale-robot plot runs/A --figure progress --phase train -o figure.png
  ale-robot plot evaluation.json --figure histogram -o figure.png

  --figure NAME        epochs, progress (by steps and time) or histogram
  --phase NAME         test or train
  -o FILE              picture: .png, .svg or .pdf

  A run needs a complete epoch; --web and TensorBoard draw from its start.
""",
    "backup": """\
Copy a run, also while it works, to go on with it elsewhere.

  ale-robot backup runs/NAME -o /mnt/backup/NAME
  ale-robot train --runs /mnt/backup --run NAME --resume       go on with it

  -o FOLDER            folder of the copy, which must not exist yet
""",
    "policies": """\
List the trained policies that are shipped; push and pull others.

  ale-robot policies                               those that are shipped
  ale-robot watch ale_pong                         watch one
  ale-robot policies pull OWNER/NAME -o FOLDER     from a hub of models
  ale-robot policies push robot_pong OWNER/NAME    to that hub

  Both need pip install 'ale-robot[hub]'.
""",
}
"""One line of what the command does, examples, and the flags that are used most: with the last line
of `help_of` at most one screen of 24 lines and 80 columns."""


def help_of(name: str) -> str:
    """Returns what `ale-robot NAME --help` prints."""
    return f"{HELP[name]}\nAll flags: ale-robot {name} --help-all"


def overview(*, everything: bool) -> str:
    """Returns what the commands are; with ``everything``, the games too."""
    lines = [
        "A simulated robot learns Atari games through its camera and its hands.",
        "Begin with `ale-robot watch`, and then `ale-robot train`.",
        "",
        *(f"  {name:<10} {text.splitlines()[0]}" for name, text in HELP.items()),
        "",
        "  ale-robot COMMAND --help        examples, and the flags that are used most",
        "  ale-robot COMMAND --help-all    every flag",
        "  ale-robot --version             version of this program",
    ]
    if everything:
        games = textwrap.fill(", ".join(GAMES), 78, initial_indent="  ", subsequent_indent="  ")
        return "\n".join([*lines, "", f"The {len(GAMES)} games of --game:", games])
    return "\n".join(
        [*lines, f"  ale-robot --help-all            the {len(GAMES)} games of --game"]
    )
