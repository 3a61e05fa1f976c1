"""Numbers of things, in words."""


def counted(count: int, thing: str) -> str:
    """Returns ``1 game`` or ``2,000 games``."""
    return f"{count:,} {thing}{'' if count == 1 else 's'}"
