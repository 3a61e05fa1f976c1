"""The gates: figures that tell, while a run goes on, whether the agent sees and touches at all.

In 2017 the robot's replay held black frames and nothing said so: the mean Q of a network
without biases was exactly 0, the loss stayed that of a predictor that sees nothing, and weeks
went by. Each gate here would have been red on the first day.
"""

from learner.status import Gate

LEAST_VALID_FRAMES = 0.99
LEAST_PIXEL_DEVIATION = 1.0
LEAST_MAX_Q_DEVIATION = 1e-6
MOST_TD_ERROR = 1.0
LEAST_KEYS_MATCHED = 0.5


def judge_gates(
    *,
    env: str,
    valid_frame_share: float | None,
    pixel_deviation: float | None,
    max_q_deviation: float | None,
    squared_td_error: float | None,
    reward_variance: float | None,
    press_match_share: float | None,
    refused_chunks: int,
) -> tuple[Gate, ...]:
    """The gates for these figures; None stands for "not measured yet", NaN fails.

    Args:
        env: ``"robot"`` adds the gate of the hands.
        valid_frame_share: frames in which the screen was found, 0 to 1.
        pixel_deviation: mean over sampled frames of the standard deviation of a frame's pixels,
            in grey levels of 255.
        max_q_deviation: standard deviation of max-Q over the held-out states.
        squared_td_error: mean of δ² per sample. Not the loss: Huber's is half of it, and the
            2017 loss is divided by the number of actions, so both would pass a blind network.
        reward_variance: variance of the (n-step, discounted) rewards in the same samples;
            where it is 0 nothing can be said.
        press_match_share: decisions whose pressed keys were the commanded ones, 0 to 1.
        refused_chunks: chunks that the replay refused.
    """
    relative_error = None
    if squared_td_error is not None and reward_variance:
        relative_error = squared_td_error / reward_variance
    gates = [
        _at_least(
            "valid frames",
            valid_frame_share,
            LEAST_VALID_FRAMES,
            "the screen is not found in the camera's picture",
        ),
        _above(
            "pixel deviation",
            pixel_deviation,
            LEAST_PIXEL_DEVIATION,
            "stored frames are black or of one grey",
        ),
        _above(
            "max-Q deviation",
            max_q_deviation,
            LEAST_MAX_Q_DEVIATION,
            "the network answers the same whatever it sees",
        ),
        Gate(
            name="relative TD error",
            value=relative_error,
            passed=None if relative_error is None else relative_error < MOST_TD_ERROR,
            bound=f"< {MOST_TD_ERROR:g}",
            why="the network predicts no better than one that sees nothing",
        ),
    ]
    if env == "robot":
        gates.append(
            _at_least(
                "keys as commanded",
                press_match_share,
                LEAST_KEYS_MATCHED,
                "the hands do not press what the policy asks for",
            )
        )
    gates.append(
        Gate(
            name="refused chunks",
            value=float(refused_chunks),
            passed=refused_chunks == 0,
            bound="= 0",
            why="actors send what the replay cannot take; their logs say what",
        )
    )
    return tuple(gates)


def _at_least(name: str, value: float | None, bound: float, why: str) -> Gate:
    passed = None if value is None else value >= bound
    return Gate(name=name, value=value, passed=passed, bound=f"≥ {bound:g}", why=why)


def _above(name: str, value: float | None, bound: float, why: str) -> Gate:
    passed = None if value is None else value > bound
    return Gate(name=name, value=value, passed=passed, bound=f"> {bound:g}", why=why)
