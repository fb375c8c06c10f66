"""The one error that a user can cause: it carries one line that says what to do."""


class InputError(ValueError):
    """Input that cannot be used. The message is one line: what is wrong, where, and what to do.

    The command line prints it and exits with code 2; a library caller may catch it as a ``ValueError``.
    """


def require(condition: bool, name: str, what: str) -> None:
    """Raises InputError that names a field, and says what it must be, unless the condition holds."""
    if not condition:
        raise InputError(f"{name}: {what}")
