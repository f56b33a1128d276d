"""The one error of files of messages."""


class BagError(ValueError):
    """What is wrong with a bag or a map, in one line: file, what was expected, what was found."""
