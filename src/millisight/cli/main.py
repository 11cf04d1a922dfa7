"""The command `millisight`: where it starts and how it ends; errors become one line. The commands are in `app`."""

import sys

from millisight.cli import interrupts

GO_ON = (
    "dataset convert", "dataset download", "dataset push", "evaluate classification", "evaluate segmentation",
    "evaluate simulator", "evaluate surface", "generate", "train classifier", "train released", "train segmenter",
)  # fmt: skip
"""Commands whose next run continues where this one stopped."""


def run() -> None:
    """Run the command line. Exit codes: 1 for an error, printed on one line; 130 for Ctrl-C; 143 for SIGTERM."""
    try:
        interrupts.listen()  # before anything else, since imports take half a second
        from millisight.cli.app import app

        app()
    except BaseException as error:
        interrupts.stop_listening()
        line, code = _ending(error)
        if not line:
            raise
        print("millisight: " + " ".join(line.split()), file=sys.stderr)  # noqa: T201
        sys.exit(code)


def _ending(error: BaseException) -> tuple[str, int]:
    """The line to print for an exception, and the exit code; an empty line: raise it."""
    if interrupts.received() and not isinstance(error, SystemExit):
        # Whatever was raised: an interrupted import, for one, may end in an ImportError.
        line = "interrupted; unfinished files were discarded, earlier files are unchanged"
        if " ".join(sys.argv[1:3]).startswith(GO_ON):
            line += "; run the same command again to continue"
        return line, 128 + interrupts.received()
    from millisight.cli.console import in_options
    from millisight.core.errors import MillisightError

    if isinstance(error, MillisightError):
        return in_options(str(error)), 1
    if isinstance(error, MemoryError):
        return f"not enough memory: {error}; use a coarser grid, fewer positions, or a larger machine", 1
    if isinstance(error, OSError):
        return f"{error.strerror or error}{f': {error.filename}' if error.filename else ''}", 1
    return "", 1


if __name__ == "__main__":
    run()
