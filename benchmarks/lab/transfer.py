"""`python -m benchmarks.lab.transfer policies/ale_pong.safetensors`: one network on every rung.

A network that was trained on one rung of the ladder (`benchmarks.lab.ladder`) plays on the others
without further training. Its scores show which difficulty it cannot cope with: the camera, the
hands, or actuation latency.
"""

from dataclasses import dataclass

from benchmarks.lab.ladder import FLAGS, Rung
from benchmarks.lab.policy import PlayingOptions, evaluate
from benchmarks.report import Report, main

_TITLES: dict[Rung, str] = {
    "R1": "the emulator alone",
    "R2": "keys that come late",
    "R3": "the camera's pixels",
    "R4": "keys pressed by the arms",
    "R5": "the robot: both",
}
_WITHOUT = ("--play.hand", "arm", "--play.eye", "camera", "--play.press-latency", "0")
"""Flags of the full robot, which replace those of the rung that the network was trained on."""


@dataclass(frozen=True)
class Options(PlayingOptions):
    """Play games by a trained network on each rung of the ladder. The network must not use the
    body's feedback, which is not the same on all rungs."""


def rung_flags(rung: Rung) -> list[str]:
    """Returns all flags of a rung, so that nothing is left of the network's own rung."""
    every = [*_WITHOUT, *FLAGS[rung]]
    flags = dict(zip(every[::2], every[1::2], strict=True))  # keeps the last value of a flag
    return [part for pair in flags.items() for part in pair]


def measure(options: Options) -> Report:
    found = {
        rung: evaluate(options.network, options.games, options.epsilon, rung_flags(rung))
        for rung in _TITLES
    }
    return Report.of(
        f"{options.network.stem} on every rung, not trained anew; {options.games} games each, "
        f"ε = {options.epsilon:g}",
        [
            {
                "rung": f"{rung}, {_TITLES[rung]}",
                "mean": each["mean"],
                "deviation": each["deviation"],
                "least": each["least"],
                "most": each["most"],
                "press p50 ms": each["press_ms"]["p50"],
            }
            for rung, each in found.items()
        ],
        {"rungs": found},
    )


if __name__ == "__main__":
    main("lab.transfer", Options, measure)
