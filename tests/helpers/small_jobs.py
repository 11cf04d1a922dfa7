"""Jobs for engines, in a module that other processes can import."""

import os
import time

from millisight.core.errors import InputError


def napping(folder, number):
    """A job that takes a while, and leaves a file that says that it began."""
    (folder / f"{number}.{os.getpid()}").touch()
    time.sleep(0.3)
    return number**2


def failing(number):
    if number == 2:
        raise InputError("no\nsuch thing")
    return number
