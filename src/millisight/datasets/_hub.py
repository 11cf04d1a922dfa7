"""The Hugging Face Hub: its library, loaded late, and its many errors as ours."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from millisight.core.errors import FileError


def hub_library() -> Any:
    """The module huggingface_hub.

    Raises
    ------
    ImportError
        It is not installed.
    """
    try:
        import huggingface_hub
        import huggingface_hub.errors
        import huggingface_hub.utils
    except ImportError as error:
        raise ImportError('the hub needs huggingface_hub: pip install "millisight[hub]"') from error
    return huggingface_hub


@contextmanager
def explained(hub: Any, repository: str, revision: str, *, writes: bool = False) -> Iterator[None]:
    """The hub's errors, of which there are many kinds, as ours, with what to do; never with the user's token in them.

    `writes`: something is sent there, not fetched.
    """
    try:
        yield
    except FileError:
        raise
    except Exception as error:
        # An upload's own errors are the causes of others, in threads.
        root = error.__cause__ if getattr(error, "response", None) is None and error.__cause__ else error
        status = getattr(getattr(root, "response", None), "status_code", None)
        reason = " ".join(str(root).split())
        if token := hub.get_token():
            reason = reason.replace(token, "***")
        kept = "what was uploaded is kept" if writes else "what was downloaded is kept"
        if isinstance(root, hub.errors.GatedRepoError) or status == 403:
            advice = (
                "you may not write there: log in with `hf auth login` as its owner, with a token that may write"
                if writes
                else "you may not read it yet: ask for access on its page, log in with `hf auth login`, and try again"
            )
        elif isinstance(root, hub.errors.RevisionNotFoundError):
            advice = f"it has no revision {revision!r}: choose another with --revision"
        elif isinstance(root, hub.errors.RepositoryNotFoundError) or status == 401:
            advice = (
                "the hub does not know you: log in with `hf auth login`, with a token that may write"
                if writes
                else "there is no such dataset, or it is private: check the name, or log in with `hf auth login`"
            )
        elif status is not None:
            advice = f"the hub answers {status} ({reason}): try again later; {kept}"
        elif isinstance(root, hub.errors.HFValidationError):
            advice = f"that is not the name of a repository ({reason}): expected owner/name"
        else:
            advice = (
                f"the hub cannot be reached, or the connection broke ({type(root).__name__}: {reason}): check the "
                f"network and try again; {kept}"
            )
        raise FileError(f"{repository}: {advice}") from error
