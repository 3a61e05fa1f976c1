"""The minus sign of numbers on screens."""


def minus_signed(number: str) -> str:
    """Returns a written number with a minus sign, as wide as a digit, for the hyphen before it."""
    return f"−{number[1:]}" if number.startswith("-") else number
