"""What is ours and what is somebody else's: that is not overwritten, unless its name was given for the output."""

import filecmp
import os
from pathlib import Path

from millisight.core._files import checked_path, make_folder, printable, write_text
from millisight.core.errors import FileError

OWN_NAME = ".millisight.folder"
"""A file that says that the folder it is in is for results of ours, until something else in it does."""


PAGE_MARK = "<footer><p>Made by millisight.</p></footer>"
"""What an `index.html` of ours holds; it marks its folder as well."""


def own_folder(path: str | os.PathLike[str]) -> Path:
    """The folder `path` for many results: it is new, empty, or marked as ours; then its files may be overwritten.

    Parameters
    ----------
    path : made where it is missing

    Raises
    ------
    FileError
        It holds files of others, or cannot be made.
    """
    folder = make_folder(path)
    index = folder / "index.html"
    if not (folder / OWN_NAME).exists():
        ours = index.is_file() and PAGE_MARK.encode() in index.read_bytes()
        if not ours and any(not entry.name.startswith(".") for entry in folder.iterdir()):
            raise FileError(
                f"{printable(folder)} is not empty and was not made by millisight, so that files could be overwritten; "
                "choose another folder"
            )
        write_text(folder / OWN_NAME, "Results of millisight, which a later run may overwrite.\n")
    return folder


def check_own(path: str | os.PathLike[str], mark: str, *, other: str = "name") -> None:
    """Refuse a file that is there and does not hold the `mark` of what we write, for it would be overwritten.

    Raises
    ------
    FileError
        With the advice to choose another `other`.
    """
    path = checked_path(path)
    if path.is_file() and mark.encode() not in path.read_bytes():
        raise FileError(
            f"{printable(path)} was not made by millisight and would be overwritten; choose another {other}"
        )


def check_free(target: Path) -> None:
    """Refuse to write where something is that was not made by this run or an earlier one.

    Raises
    ------
    FileError
    """
    if os.path.lexists(target):
        raise FileError(
            f"{printable(target)} is there already, was not made here, and would be overwritten; move it away"
        )


def move_into(source: Path, target: Path, *, known: bool) -> None:
    """Move a whole file to its place; its folder is made.

    Parameters
    ----------
    source : on the same disk
    known : the file that is there was made by us, as somebody noted; if not, it stays, unless it is the same

    Raises
    ------
    FileError
        A file that somebody else may have put there, or a folder, would be lost; or it cannot be moved.
    """
    make_folder(target.parent)
    try:
        if not known and not (target.is_file() and filecmp.cmp(source, target, shallow=False)):
            check_free(target)
        os.replace(source, target)
    except FileError:
        raise
    except OSError as error:
        raise FileError(f"cannot write {printable(target)}: {error.strerror or error}") from error
