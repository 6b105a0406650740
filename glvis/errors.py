"""The two ways a run can fail, by whose doing; the command line turns them into exit codes."""


class StudyError(ValueError):
    """What the user wrote cannot be run: where, what was found, what is allowed. Exit code 2."""


class MachineError(RuntimeError):
    """What this machine refused: no OpenGL, a broken driver, no permission. Exit code 1."""
