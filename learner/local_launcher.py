"""Local mode: actors and evaluators as supervised children of the learner."""

from functools import partial

from common.process.supervisor import Child, Supervisor
from common.run.folder import RunFolder
from learner.options import LearnerOptions, local_names


def launch(options: LearnerOptions, endpoint: str, folder: RunFolder) -> Supervisor:
    """Starts the actors and evaluators of a run on this machine; they log into its folder.

    In lockstep they have a lower priority than the learner. In real time they do not, because
    their deadlines do not wait.
    """
    actors, evaluators = local_names(options)
    playing = ["--envs", str(options.envs), "--precision", options.precision]
    playing += ["--kernel", options.kernel]
    roles = dict.fromkeys(actors, playing)
    roles |= {name: ["--evaluator"] for name in evaluators}
    common = ["--connect", endpoint, "--run", folder.name, *options.clock.flags()]
    if options.log_json:
        common.append("--log-json")
    if options.certificates is not None:
        common += ["--certificates", str(options.certificates)]
    return Supervisor(
        {
            name: partial(
                Child,
                *("actors", "--name", name, *common, *own),
                leash=True,
                low_priority=options.clock.sync,
                log=folder.logs / f"{name}.log",
            )
            for name, own in roles.items()
        }
    )
