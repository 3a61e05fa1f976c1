"""The columns of a recording: of every field of a step, by the names that recordings have."""

from common.dataset.layout import COLUMNS
from common.protocol.step_fields import STEP_FIELDS


def test_each_field_of_a_step_has_the_column_that_it_always_had() -> None:
    assert COLUMNS.keys() == STEP_FIELDS.keys()
    assert COLUMNS.items() >= {
        ("frames", "observation.frame"),
        ("valid", "observation.valid"),
        ("vectors", "observation.vector"),
        ("actions", "action"),
        ("rewards", "next.reward"),
        ("terminated", "next.terminated"),
        ("truncated", "next.truncated"),
        ("elapsed", "next.elapsed"),
        ("follows", "next.follows"),
        ("matched", "next.matched"),
    }
