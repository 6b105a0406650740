"""The two ways a run can fail, by whose doing; the command line turns them into exit codes."""


class StudyError(ValueError):
    """What the user wrote cannot be run: where, what was found, what is allowed. Exit code 2."""


class MachineError(RuntimeError):
    """What this machine refused: no OpenGL, a broken driver, no permission. Exit code 1."""


def installed_by(extra: str) -> str:
    """Return how an optional part is installed; never from an index: its glvis is another one."""
    return (
        f'install it by: pip install ".[{extra}]" in the checkout of glvis, or pip install '
        f'"WHEEL[{extra}]" with the path of its wheel'
    )
