"""What can go wrong in a way that the user can mend: each error's text is one clear line."""

__all__ = [
    "ArchiveError",
    "NotApplicableError",
    "OutputExistsError",
    "PictureError",
    "SetupError",
    "StoppedError",
    "StratifyError",
]


class StratifyError(Exception):
    """The common ancestor of every error that these packages raise on purpose."""


class SetupError(StratifyError):
    """A set-up is wrong: the text names the field, its value and what is allowed."""


class NotApplicableError(SetupError):
    """The set-up is sound, but this is not for it: a model, a measurement, a picture."""


class ArchiveError(StratifyError):
    """A file is not a whole archive of these models, or cannot be read or written."""


class OutputExistsError(StratifyError):
    """An output is there already, and nobody said that it may be replaced."""


class StoppedError(StratifyError):
    """A pour was told to stop, and did so where it can go on from."""


class PictureError(StratifyError):
    """A picture cannot be read, or shows no deposit of two colours that could be measured."""
