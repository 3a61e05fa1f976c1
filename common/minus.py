"""The minus sign of numbers on screens."""


def minus_signed(number: str) -> str:
    """Returns a number's text with its hyphen replaced by a minus sign, as wide as a digit, or
    without it if the number was rounded to 0."""
    if not number.startswith("-"):
        return number
    return f"−{number[1:]}" if number.strip("-0.") else number[1:]


def points(score: float) -> str:
    """Returns the score of a game as text."""
    return minus_signed(f"{score:.10g}")
