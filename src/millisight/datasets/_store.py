"""An object store by its URL, such as s3://bucket/prefix: fsspec, loaded late, and its many errors as ours."""

import re
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TypeVar

from millisight.core import printable
from millisight.core.errors import FileError, FormatError, InputError, MillisightError

T = TypeVar("T")

_CHUNK = 1 << 20  # bytes
_MD5 = re.compile(r"[0-9a-f]{32}")
_LONGEST = 300  # characters of what a store says
_PARTIAL = ".partial"  # ends names of files that are not whole yet, where the store has folders
_KEPT = "what was transferred is kept"
_NO_BUCKET = "there is no such bucket or folder {told}: check its name; buckets are not made here"
_NO_FILE = "there is no such file {told}, though it is listed: send it again"


def is_url(place: str) -> bool:
    """Whether a dataset's place is the URL of an object store, not a name on the hub."""
    return "://" in place


class Store:
    """A place in an object store; paths are relative to it, with "/".

    Parameters
    ----------
    url : of any protocol that fsspec knows: s3://bucket/prefix, gs://, abfs://, sftp://, file://, https:// to read

    Raises
    ------
    ImportError
        fsspec, or its package for that protocol, is not installed.
    InputError
        There is no such protocol, or the URL names no place.
    FileError
        The store cannot be used.
    """

    def __init__(self, url: str):
        self.url = re.sub(r"(?<=://)[^/@]*@", "***@", url)  # as it is shown: without a password
        library = _library()
        protocol = url.partition("://")[0].rpartition("::")[2]
        try:
            library.get_filesystem_class(protocol)
        except ValueError as error:
            raise InputError(
                f"{self.url}: no protocol {protocol}:// is known; expected one such as s3, gs, abfs or file"
            ) from error
        except ImportError as error:
            raise ImportError(
                f"{protocol}:// needs a package that is not installed ({error}); that for s3:// comes with pip install "
                '"millisight[store]"'
            ) from error
        with explained(self.url):
            # As the settings are now; listings are wanted as they are now, too.
            self._fs, root = library.core.url_to_fs(url, use_listings_cache=False, skip_instance_cache=True)
        self._root = root.rstrip("/")
        if not self._root:
            raise InputError(f"{self.url} names no place in the store; expected a URL such as s3://bucket/prefix")

    def listing(self, *, writes: bool = False) -> dict[str, Mapping[str, Any]]:
        """What the store tells of every file: "size" [bytes] and more.

        Raises
        ------
        FileError
        """
        with explained(self.url, missing=_NO_BUCKET, writes=writes):
            found = self._fs.find(self._root, detail=True)
        start = len(self._root) + 1
        return {path[start:]: info for path, info in found.items() if path.startswith(f"{self._root}/")}

    def send(self, path: str, file: Path) -> None:
        """Put a file there, whole or not at all.

        Raises
        ------
        FileError
        """
        with explained(self.url, missing=_NO_BUCKET, writes=True):
            target = f"{self._root}/{path}"
            if self._fs.async_impl:  # of objects, which are there when they are whole
                self._fs.put_file(str(file), target)
                return
            self._fs.makedirs(target.rpartition("/")[0], exist_ok=True)
            self._fs.put_file(str(file), target + _PARTIAL)
            self._fs.mv(target + _PARTIAL, target)

    def remove(self, path: str = "") -> None:
        """Remove a folder with all files in it; without a path everything.

        Raises
        ------
        FileError
        """
        with explained(self.url, writes=True), suppress(FileNotFoundError):
            self._fs.rm(f"{self._root}/{path}".rstrip("/"), recursive=True)

    def info(self, path: str) -> Mapping[str, Any] | None:
        """What the store tells of a file, as `listing` does; None where there is none.

        Raises
        ------
        FileError
        """
        with explained(self.url):
            try:
                return self._fs.info(f"{self._root}/{path}")
            except FileNotFoundError:
                return None

    def chunks(self, path: str) -> Iterator[bytes]:
        """The content of a file, in pieces.

        Raises
        ------
        FileError
        """
        with explained(f"{self.url}/{path}", missing=_NO_FILE), self._fs.open(f"{self._root}/{path}", "rb") as file:
            while chunk := file.read(_CHUNK):
                yield chunk

    def read(self, path: str, most: int) -> bytes:
        """The content of a file of so many bytes at most.

        Raises
        ------
        FileError
        """
        content = bytearray()
        for chunk in self.chunks(path):
            content += chunk
            if len(content) > most:
                raise FormatError(f"{self.url}/{path} has more bytes than the {most} that such a file may have")
        return bytes(content)


def told_md5(info: Mapping[str, Any]) -> str:
    """MD5 of a file, in hexadecimal digits, as a store's listing tells it; "" where it does not.

    S3 tells it as ETag of objects that were sent in one piece.
    """
    etag = str(info.get("ETag", "")).strip('"')
    return etag if _MD5.fullmatch(etag) else ""


def in_threads(function: Callable[[T], Any], things: Sequence[T], workers: int) -> Generator[tuple[T, Any], None, None]:
    """(thing, result) of a function, in several threads, as they are done; once closed, no more of them begin."""
    with ThreadPoolExecutor(workers) as pool:
        futures = {pool.submit(function, thing): thing for thing in things}
        try:
            for future in as_completed(futures):
                yield futures[future], future.result()
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def _library() -> Any:
    try:
        import fsspec
        import fsspec.core
    except ImportError as error:
        raise ImportError('object stores need fsspec: pip install "millisight[store]"') from error
    return fsspec


@contextmanager
def explained(url: str, *, missing: str = _NO_BUCKET, writes: bool = False) -> Iterator[None]:
    """The errors of a store, of which every kind has its own, as ours, with what to do.

    `missing`: what to say where something is not there; `writes`: something is sent there, not fetched.
    """
    try:
        yield
    except (MillisightError, ImportError):
        raise
    except Exception as error:
        kinds = {kind.__name__ for kind in type(error).__mro__}
        told = f"({type(error).__name__}: {printable(' '.join(str(error).split()))[:_LONGEST]})"
        if kinds & {"NoCredentialsError", "PartialCredentialsError", "ProfileNotFound", "DefaultCredentialsError"}:
            advice = f"no credentials were found {told}: set them, for S3 by AWS_PROFILE or `aws configure`"
        elif kinds & {"PermissionError", "ClientAuthenticationError"}:
            may = "write" if writes else "read"
            advice = f"the store does not let you {may} there {told}: check your credentials, and what they may do"
        elif "FileNotFoundError" in kinds:
            advice = missing.format(told=told)
        elif "NotImplementedError" in kinds:
            advice = "this store can only be read" if writes else f"this store cannot do that {told}"
        elif "FlexibleChecksumError" in kinds:  # S3 has checksums of its own
            advice = f"it was damaged on the way {told}: try again; {_KEPT}"
        elif any(re.search("Connect|Timeout|Payload|Disconnected", kind) for kind in kinds):
            advice = (
                "the store cannot be reached, or the connection broke "
                f"{told}: check the network and the address, and try again; {_KEPT}"
            )
        else:
            advice = f"the store answers with an error {told}: check the address, and try again later; {_KEPT}"
        raise FileError(f"{url}: {advice}") from error
