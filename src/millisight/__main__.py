"""`python -m millisight` is the command `millisight`."""

from millisight.cli.main import run

if __name__ == "__main__":
    run()
