"""What a learner tells over HTTP: health, readiness, checks, and actors within bounds."""

from collections.abc import Iterable

from common.protocol.actor_stats import ActorStats
from common.protocol.run_status import HealthCheck
from learner.telemetry.health_checks import LONGEST_SILENCE
from learner.telemetry.sinks.prometheus import MAX_ACTOR_SERIES, PrometheusSink
from learner.telemetry.snapshot import ActorView
from tests.clock import Clock
from tests.learner.telemetry.snapshots import snapshot


def check(name: str, passed: bool | None, *, stops: bool = True) -> HealthCheck:
    return HealthCheck(name=name, value=1.0, passed=passed, bound="> 2", why="so", stops=stops)


def actor(name: str, *, alive: bool = True, silent_for: float = 0.0) -> ActorView:
    stats = ActorStats(name, "actor", steps=70, key_times=(1,) * 120)
    return ActorView(stats=stats, alive=alive, silent_for=silent_for)


def samples(sink: PrometheusSink, name: str) -> Iterable[tuple[dict[str, str], float]]:
    (found,) = (each for each in sink.collect() if each.name == name)
    return [(each.labels, each.value) for each in found.samples]


def test_a_learner_is_ready_from_its_first_figures_on_while_it_looks_around() -> None:
    clock = Clock(100.0)
    sink = PrometheusSink(clock)
    pages = sink.pages()
    assert pages["/healthz"]().status == 200
    assert pages["/readyz"]() == (b"the learner is starting\n", "text/plain; charset=utf-8", 503)
    sink.write(snapshot({}))
    assert pages["/readyz"]().body == b"ok\n"
    clock.now += LONGEST_SILENCE
    for path in ("/healthz", "/readyz"):
        assert pages[path]().status == 503
        assert b"not looked around for 60 s" in pages[path]().body
    sink.write(snapshot({}))
    assert pages["/healthz"]().status == pages["/readyz"]().status == 200


def test_only_a_red_check_that_ends_runs_makes_it_unready_and_none_unhealthy() -> None:
    sink = PrometheusSink()
    warns = (check("press", False, stops=False), check("open", None), check("green", True))
    sink.write(snapshot({}, checks=warns))
    assert sink.pages()["/readyz"]().status == 200
    assert samples(sink, "ale_robot_gates_red") == [
        ({"check": "press", "stops": "false"}, 1),
        ({"check": "green", "stops": "true"}, 0),
    ]
    sink.write(snapshot({}, checks=(*warns, check("sight", False))))
    assert sink.pages()["/readyz"]().body == b"health check 'sight' is red: so\n"
    assert sink.pages()["/healthz"]().status == 200


def test_actors_by_name_and_role() -> None:
    sink = PrometheusSink()
    sink.write(snapshot({}, actors=(actor("a"), actor("b", alive=False, silent_for=7.0))))
    labels = [{"actor": name, "role": "actor"} for name in ("a", "b")]
    assert samples(sink, "ale_robot_actor_alive") == [(labels[0], 1), (labels[1], 0)]
    assert samples(sink, "ale_robot_actor_silent_for_seconds") == [(labels[0], 0), (labels[1], 7)]
    assert samples(sink, "ale_robot_actor_steps") == [(labels[0], 70), (labels[1], 70)]


def test_however_many_come_the_series_are_bounded_and_the_living_come_first() -> None:
    sink = PrometheusSink()
    dead = tuple(actor(f"d{i}", alive=False) for i in range(MAX_ACTOR_SERIES + 10))
    sink.write(snapshot({}, actors=(*dead, actor("z"))))
    told = [labels["actor"] for labels, _ in samples(sink, "ale_robot_actor_alive")]
    assert (len(told), told[0]) == (MAX_ACTOR_SERIES, "z")
    assert samples(sink, "ale_robot_actors_omitted_processes") == [({}, 11)]
