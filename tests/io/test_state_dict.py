"""What a file of torch's weights may hold; the files are put together here, without torch."""

import struct
import zipfile

import pytest

from millisight.core.errors import DamagedFileError, FileError, FormatError
from millisight.io.arrays import check_state_dict

HEAD = b"\x80\x02"
NAMED = b"ccollections\nOrderedDict\n)R"


def text(value):
    return b"X" + struct.pack("<I", len(value)) + value


def storage(*, key=b"0", count=6, kind=b"Float"):
    """The step by which a pickle asks for a storage of another member."""
    name = text(b"storage") + b"ctorch\n" + kind + b"Storage\n" + text(key) + text(b"cpu")
    return b"(" + name + b"J" + struct.pack("<i", count) + b"tQ"


def tensor(**options):
    return b"ctorch._utils\n_rebuild_tensor_v2\n(" + storage(**options) + b"K\0K\2K\3\x86K\3K\1\x86\x89" + NAMED + b"tR"


def table(content):
    return HEAD + NAMED + text(b"a.weight") + content + b"s."


@pytest.fixture
def written(tmp_path):
    """Writes an archive as torch does, around a pickle, and returns where."""

    def write(program, *, size=24, compression=zipfile.ZIP_STORED, twice=False):
        with zipfile.ZipFile(tmp_path / "w.pt", "w", compression) as archive:
            archive.writestr("archive/data.pkl", program)
            archive.writestr("archive/data/0", bytes(size))
            if twice:
                archive.writestr("other/data.pkl", program)
        return tmp_path / "w.pt"

    return write


@pytest.mark.parametrize(
    "program",
    [
        table(tensor()),
        table(tensor(kind=b"Double", count=3)),
        HEAD + b"}" + text(b"a") + tensor() + b"s.",
        table(tensor())[:-1] + b"}" + text(b"_metadata") + NAMED + b"sb.",
        table(b"ctorch._utils\n_rebuild_parameter\n" + tensor() + b"\x88" + NAMED + b"\x87R"),
    ],
    ids=["float", "double", "dict", "metadata", "parameter"],
)
def test_tensors_by_name_pass(written, program):
    check_state_dict(written(program))


DOUBLED = b"(]q\0" + b"".join(b"h%c" % i + b"h%c" % i + b"\x86q%c" % (i + 1) for i in range(60)) + b"t"


@pytest.mark.parametrize(
    ("program", "message"),
    [
        (table(b"cos\nmkdir\n" + text(b"x") + b"\x85R"), "asks for os.mkdir"),
        (table(b"ctorch._utils\n" + b"a." * 20_000 + b"\n)R"), r"asks for torch\._utils\.a\.a\.a\."),
        (table(text(b"x" * 20_000) + b")R"), None),
        (table(b"ctorch\nFloatStorage\nK\x01\x85R"), r"calls torch\.FloatStorage with 1 arguments"),
        (table(NAMED[:-2] + b"K\1\x85R"), "calls collections.OrderedDict with 1 arguments"),
        (table(b"ctorch\nFloatStorage\n"), "a global"),
        (table(DOUBLED), "its shared parts counted each time|deep"),
        (table(b"(" + b"K\1" * 100_001 + b"l"), "the pickle has more than 100000 steps"),
        (table(storage().replace(b"storage", b"modules")), "something in another file"),
        (table(b"K\1Q"), None),
        (table(b"0"), "the step POP"),
        (table(tensor(count=7)), None),
        (table(tensor(count=-6)), None),
        (table(tensor(key=b"1")), None),
        (table(b"(" + tensor() + tensor(count=7) + b"t"), None),
        (table(tensor())[:-1], None),
        (b"", None),
    ],
)
def test_anything_else_is_refused(written, program, message):
    error = DamagedFileError if message is None else FormatError
    with pytest.raises(error, match=rf"w\.pt is not .*state dict.*{message or ''}"):
        check_state_dict(written(program))


def test_an_archive_that_is_not_torchs_is_refused(written, tmp_path):
    program = table(tensor())
    with pytest.raises(DamagedFileError, match="data/0 has 23 bytes; expected 24"):
        check_state_dict(written(program, size=23))
    with pytest.raises(FormatError, match="compressed, which torch's are not"):
        check_state_dict(written(program, compression=zipfile.ZIP_DEFLATED))
    with pytest.raises(DamagedFileError, match="share a name"):
        check_state_dict(written(program, twice=True))
    with pytest.raises(FileError, match="no such file"):
        check_state_dict(tmp_path / "none.pt")


def test_files_from_before_the_zip_are_five_pickles(tmp_path):
    numbers = (HEAD + b"K\1.") * 3
    keys, path = HEAD + b"]" + text(b"0") + b"a.", tmp_path / "w.pt"
    path.write_bytes(numbers + table(tensor()) + keys + struct.pack("<q", 6) + bytes(24))
    check_state_dict(path)
    path.write_bytes(numbers + table(tensor(count=1 << 30)) + keys + struct.pack("<q", 6) + bytes(24))
    with pytest.raises(DamagedFileError, match="tensors of 4294967296 bytes in a file of"):
        check_state_dict(path)
    path.write_bytes(numbers)
    with pytest.raises(DamagedFileError, match="not a state dict that torch saved"):
        check_state_dict(path)
