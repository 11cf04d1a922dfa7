"""Weights and their description: what is read, and what is refused."""

import hashlib
import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from millisight.core.errors import DamagedFileError, FileError, FormatError
from millisight.perception import _networks as networks
from millisight.perception import open_network, read_description, run_network


def doubler(onnx, *, shape=("n", 3), **external):
    """An ONNX network that doubles its input, as bytes; its 2 may be said to lie in another file."""
    two = onnx.numpy_helper.from_array(np.array([2], np.float32), "two")
    if external:
        two.data_location = onnx.TensorProto.EXTERNAL
        two.ClearField("raw_data")
        for key, value in external.items():
            two.external_data.add(key=key, value=str(value))
    one = onnx.helper.make_tensor_value_info
    graph = onnx.helper.make_graph(
        [onnx.helper.make_node("Mul", ["x", "two"], ["y"])],
        "doubler",
        [one("x", onnx.TensorProto.FLOAT, shape)],
        [one("y", onnx.TensorProto.FLOAT, shape)],
        [two],
    )
    opset = [onnx.helper.make_opsetid("", 17)]
    return onnx.helper.make_model(graph, ir_version=8, opset_imports=opset).SerializeToString()


def sha256(content):
    return hashlib.sha256(content).hexdigest()


@pytest.fixture
def written(tmp_path):
    """Writes the weights and returns where they are, and their SHA-256."""

    def write(content):
        (tmp_path / "w.onnx").write_bytes(content)
        return tmp_path / "w.onnx", sha256(content)

    return write


def test_a_network_is_opened_and_runs(written):
    onnx = pytest.importorskip("onnx")
    session = open_network(*written(doubler(onnx)), needed_by="this", channels=3)
    (y,) = session.run(None, {"x": np.arange(3, dtype=np.float32)[None]})
    np.testing.assert_array_equal(y, [[0, 2, 4]])


@pytest.mark.parametrize(("shape", "taken"), [(("n", 3), (3,)), (("n", "c", "a"), (1, 3)), (("n",), ()), ((), ())])
def test_a_network_that_takes_something_else_is_refused(written, shape, taken):
    onnx = pytest.importorskip("onnx")
    weights = written(doubler(onnx, shape=shape))
    for channels in (1, 3):
        if channels in taken:
            open_network(*weights, needed_by="this", channels=channels)
        else:
            with pytest.raises(
                FormatError, match=rf"w\.onnx takes x .* with {channels} channels.* not a network for this"
            ):
                open_network(*weights, needed_by="this", channels=channels)


def test_weights_are_refused_that_are_others_or_no_network(written, monkeypatch):
    onnx = pytest.importorskip("onnx")
    content = doubler(onnx)
    path, told = written(content)
    with pytest.raises(DamagedFileError, match=r"w\.onnx is not the file that w\.json describes"):
        open_network(path, sha256(b""), needed_by="this")
    path.write_bytes(content[:-1])
    with pytest.raises(DamagedFileError, match="SHA-256 differs"):
        open_network(path, told, needed_by="this")
    for nothing in (b"", b"no network", content[:40]):
        with pytest.raises(FormatError, match=r"w\.onnx is not a network that ONNX Runtime can run"):
            open_network(*written(nothing), needed_by="this")
    monkeypatch.setattr(networks, "_MOST_WEIGHTS", len(content) - 1)
    with pytest.raises(FormatError, match=rf"w\.onnx has {len(content)} bytes; expected weights, under"):
        open_network(*written(content), needed_by="this")
    path.unlink()
    with pytest.raises(FileError, match=r"w\.onnx: no such file"):
        open_network(path, told, needed_by="this")


def test_weights_that_would_have_another_file_read_are_refused(written, tmp_path, monkeypatch):
    onnx = pytest.importorskip("onnx")
    (tmp_path / "other.bin").write_bytes(np.array([2], np.float32).tobytes())
    content = doubler(onnx, location="other.bin", offset=0, length=4)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(FormatError, match=r"w\.onnx is not a network"):
        open_network(*written(content), needed_by="this")


def test_without_onnx_runtime_it_says_who_needs_it_and_what_to_install(written, monkeypatch):
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    with pytest.raises(ImportError, match=r'^this runs by ONNX Runtime: pip install "millisight\[perception\]"$'):
        open_network(*written(b""), needed_by="this")


def test_a_description_is_what_its_file_holds(tmp_path):
    told = {"sha256": "ab", "cut": 0.5, "about": "käse"}
    (tmp_path / "w.json").write_text(json.dumps(told, ensure_ascii=False), encoding="utf-8")
    assert read_description(tmp_path / "w.json", "cut", "about") == told


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "does not describe weights"),
        (b"{", "does not describe weights"),
        (b"\xff\xfe", "does not describe weights"),
        (b"[]", "does not describe weights"),
        (b'"sha256"', "does not describe weights"),
        (b"null", "does not describe weights"),
        (b"[" * 100_000, "does not describe weights"),
        (b'{"cut": 1}', r"does not describe weights: KeyError\('sha256'\)"),
        (b'{"sha256": "ab"}', r"does not describe weights: KeyError\('cut'\)"),
        (b'{"sha256": 7, "cut": 1}', "sha256 is 7"),
    ],
)
def test_what_describes_no_weights_is_refused(tmp_path, content, message):
    (tmp_path / "w.json").write_bytes(content)
    with pytest.raises(DamagedFileError, match=r"w\.json.*" + message):
        read_description(tmp_path / "w.json", "cut")


def test_a_description_that_is_missing_or_huge_is_refused(tmp_path, monkeypatch):
    with pytest.raises(FileError, match=r"w\.json: no such file; it describes w\.onnx, and must lie beside it"):
        read_description(tmp_path / "w.json")
    monkeypatch.setattr(networks, "_MOST_DESCRIPTION", 10)
    (tmp_path / "w.json").write_text('{"sha256": "ab"}')
    with pytest.raises(FormatError, match=r"w\.json has 16 bytes; expected a description of weights, under 10 bytes"):
        read_description(tmp_path / "w.json")


def endless(onnx):
    """An ONNX network whose loop runs 2^62 times."""
    make, number = onnx.helper, onnx.TensorProto
    body = make.make_graph(
        [
            make.make_node("Identity", ["go"], ["go_on"]),
            make.make_node("Add", ["state", "state"], ["next"]),
        ],
        "body",
        [
            make.make_tensor_value_info("turn", number.INT64, []),
            make.make_tensor_value_info("go", number.BOOL, []),
            make.make_tensor_value_info("state", number.FLOAT, None),
        ],
        [
            make.make_tensor_value_info("go_on", number.BOOL, []),
            make.make_tensor_value_info("next", number.FLOAT, None),
        ],
    )
    most = onnx.numpy_helper.from_array(np.array(1 << 62, np.int64), "most")
    go = onnx.numpy_helper.from_array(np.array(True), "true")
    graph = make.make_graph(
        [make.make_node("Loop", ["most", "true", "x"], ["y"], body=body)],
        "endless",
        [make.make_tensor_value_info("x", number.FLOAT, ("n", 3))],
        [make.make_tensor_value_info("y", number.FLOAT, ("n", 3))],
        [most, go],
    )
    return make.make_model(graph, ir_version=8, opset_imports=[make.make_opsetid("", 17)]).SerializeToString()


def test_a_network_that_never_ends_is_not_opened(written):
    onnx = pytest.importorskip("onnx")
    with pytest.raises(FormatError, match=r"w\.onnx has the operators Loop; expected those of ONNX without loops"):
        open_network(*written(endless(onnx)), needed_by="this", channels=3)


def test_operators_of_others_are_not_run(written):
    onnx = pytest.importorskip("onnx")
    content = onnx.load_model_from_string(doubler(onnx))
    content.graph.node[0].domain = "com.example"
    with pytest.raises(FormatError, match=r"has the operators com\.example\.Mul"):
        open_network(*written(content.SerializeToString()), needed_by="this", channels=3)


@pytest.mark.parametrize("content", [b"\x3a\xff\xff\xff\xff\x0f", b"\x3a", b"\xff" * 20, b"\x3b", b"\x3a\x05ab"])
def test_what_is_no_model_is_refused(written, content):
    pytest.importorskip("onnxruntime")
    with pytest.raises(FormatError, match="is not a network that ONNX Runtime can run"):
        open_network(*written(content), needed_by="this")


def test_a_network_that_fails_as_it_runs_is_an_error_of_ours(written):
    onnx = pytest.importorskip("onnx")
    session = open_network(*written(doubler(onnx)), needed_by="this", channels=3)
    with pytest.raises(FormatError, match=r"the network fails on \(1, 4\): .*; train it again"):
        run_network(session, np.zeros((1, 4), np.float32))
    content = onnx.load_model_from_string(doubler(onnx, shape=(3, 3)))
    content.graph.node[0].op_type = "ReduceSum"
    content.graph.node[0].input.pop()
    content.graph.output[0].type.tensor_type.ClearField("shape")
    session = open_network(*written(content.SerializeToString()), needed_by="this", channels=3)
    with pytest.raises(FormatError, match=r"the network makes \(1, 1\) of \(3, 3\); expected as many"):
        run_network(session, np.zeros((3, 3), np.float32))


@pytest.mark.parametrize("channels", [3, None])
@pytest.mark.parametrize("which", ["input", "output"])
def test_a_name_that_is_not_utf8_is_refused(written, which, channels):
    """It ended in a UnicodeDecodeError."""
    onnx = pytest.importorskip("onnx")
    model = onnx.load_model_from_string(doubler(onnx))
    getattr(model.graph, which)[0].type.tensor_type.shape.dim[0].dim_param = "name"
    content = model.SerializeToString().replace(b"name", b"\xff\xfe\xfd\xfc")
    with pytest.raises(FormatError, match=r"w\.onnx is not a network that ONNX Runtime can run: 'utf-8' codec"):
        open_network(*written(content), needed_by="this", channels=channels)


@pytest.mark.parametrize("operator", ["ConstantOfShape", "Expand"])
def test_a_network_that_makes_more_than_memory_holds_fails_as_it_runs(written, operator):
    """170 bytes took 6.4 GB."""
    onnx = pytest.importorskip("onnx")
    make, number = onnx.helper, onnx.TensorProto
    shape = onnx.numpy_helper.from_array(np.array([40_000, 40_000]), "shape")
    given = ["shape"] if operator == "ConstantOfShape" else ["first", "shape"]
    graph = make.make_graph(
        [
            make.make_node("ReduceMax", ["x"], ["first"], keepdims=0),
            make.make_node(operator, given, ["large"]),
            make.make_node("ReduceMax", ["large"], ["most"], keepdims=0),
            make.make_node("Add", ["x", "most"], ["y"]),
        ],
        "large",
        [make.make_tensor_value_info("x", number.FLOAT, ("n", 3))],
        [make.make_tensor_value_info("y", number.FLOAT, ("n", 3))],
        [shape],
    )
    model = make.make_model(graph, ir_version=8, opset_imports=[make.make_opsetid("", 17)])
    session = open_network(*written(model.SerializeToString()), needed_by="this", channels=3)
    with pytest.raises(FormatError, match=rf"the network fails on \(2, 3\): .* running {operator} node"):
        run_network(session, np.zeros((2, 3), np.float32))


def tensor(onnx, values, *, elsewhere):
    made = onnx.numpy_helper.from_array(np.asarray(values, np.float32), "w")
    if elsewhere:
        made.ClearField("raw_data")
        made.data_location = onnx.TensorProto.EXTERNAL
        made.external_data.add(key="location", value="secret.bin")
    return made


def summing(onnx, *, elsewhere, within):
    """x (n, 1024) to its sums weighted by a tensor: an initializer, a sparse one, a constant, or one in a function."""
    helper, kind = onnx.helper, onnx.TensorProto.FLOAT
    weights = tensor(onnx, np.ones((1024, 2)), elsewhere=elsewhere)
    graph = {"nodes": [helper.make_node("MatMul", ["x", "w"], ["y"])], "initializer": [weights]}
    functions = []
    if within == "sparse":
        flat = tensor(onnx, np.ones(2048), elsewhere=elsewhere)
        places = onnx.numpy_helper.from_array(np.arange(2048, dtype=np.int64), "places")
        graph = {"nodes": graph["nodes"], "initializer": []}
        sparse = helper.make_sparse_tensor(flat, places, [1024, 2])
    elif within != "initializer":
        constant = helper.make_node("Constant", [], ["w"], value=weights)
        graph = {"nodes": [constant, *graph["nodes"]], "initializer": []}
        if within == "function":
            opset = [helper.make_opsetid("", 17)]
            functions = [helper.make_function("ours", "Sum", ["x"], ["y"], graph["nodes"], opset)]
            graph["nodes"] = [helper.make_node("Sum", ["x"], ["y"], domain="ours")]
    values = [helper.make_tensor_value_info(name, kind, ["n", count]) for name, count in (("x", 1024), ("y", 2))]
    made = helper.make_graph(graph["nodes"], "sum", values[:1], values[1:], graph["initializer"])
    if within == "sparse":
        made.sparse_initializer.append(sparse)
    opsets = [helper.make_opsetid("", 17), helper.make_opsetid("ours", 1)]
    return helper.make_model(made, ir_version=8, opset_imports=opsets, functions=functions).SerializeToString()


@pytest.mark.parametrize("within", ["initializer", "sparse", "constant", "function"])
def test_numbers_in_a_file_of_the_working_directory_are_not_read(written, tmp_path, monkeypatch, within):
    """Large ones, which ONNX Runtime would look for where the program was started."""
    onnx = pytest.importorskip("onnx")
    monkeypatch.chdir(tmp_path)
    np.full(2048, 9, np.float32).tofile("secret.bin")
    with pytest.raises(FormatError, match=r"w\.onnx is not a network .*: it has numbers read from another file"):
        open_network(*written(summing(onnx, elsewhere=True, within=within)), needed_by="this")
    if within != "function":  # an operator of others
        session = open_network(*written(summing(onnx, elsewhere=False, within=within)), needed_by="this")
        np.testing.assert_array_equal(run_network(session, np.ones((1, 1024), np.float32)), [[1024, 1024]])


def long_network(onnx, steps=2000):
    """So many products of large matrices; all of them take minutes."""
    helper, node, kind = onnx.helper, onnx.helper.make_node, onnx.TensorProto.FLOAT
    shape = onnx.numpy_helper.from_array(np.array([1500, 1500]), "shape")
    nodes = [node("ReduceMean", ["x"], ["mean"], keepdims=0), node("Expand", ["mean", "shape"], ["m0"])]
    nodes += [node("MatMul", [f"m{i}", "m0"], [f"m{i + 1}"]) for i in range(steps)]
    nodes += [node("ReduceMean", [f"m{steps}"], ["end"], keepdims=0), node("Add", ["x", "end"], ["y"])]
    values = [helper.make_tensor_value_info(name, kind, ["n", 3]) for name in "xy"]
    graph = helper.make_graph(nodes, "long", values[:1], values[1:], [shape])
    opset = [helper.make_opsetid("", 17)]
    return helper.make_model(graph, ir_version=8, opset_imports=opset).SerializeToString()


@pytest.mark.slow
def test_a_network_that_takes_too_long_is_ended(written, monkeypatch):
    onnx = pytest.importorskip("onnx")
    session = open_network(*written(long_network(onnx)), needed_by="this")
    monkeypatch.setattr(networks, "_SECONDS", 0)
    began = time.process_time()  # on a busy machine the clock goes on without the network
    with pytest.raises(FormatError, match=r"the network takes over 1 s for \(1, 3\)"):
        run_network(session, np.zeros((1, 3), np.float32))
    assert time.process_time() - began < 20  # all of it takes minutes


@pytest.mark.slow
def test_a_network_on_a_machine_that_sleeps_is_waited_for(written, monkeypatch):
    onnx = pytest.importorskip("onnx")
    session = open_network(*written(long_network(onnx, steps=4)), needed_by="this")
    monkeypatch.setattr(networks, "_SECONDS", -0.999)
    monkeypatch.setattr(networks, "process_time", lambda: 0.0)
    assert run_network(session, np.ones((1, 3), np.float32)).shape == (1, 3)


def test_onnx_runtime_sends_and_stores_nothing_of_its_own(tmp_path, written):
    """It does where nobody says otherwise: see `_onnx_runtime`."""
    onnx = pytest.importorskip("onnx")
    path, told = written(doubler(onnx))
    home = tmp_path / "home"
    home.mkdir()
    script = f"from millisight.perception._networks import open_network as o; o({str(path)!r}, {told!r}, needed_by='x')"
    known = {
        name: value for name, value in os.environ.items() if name not in ("ORT_DISABLE_TELEMETRY", "XDG_CACHE_HOME")
    }
    subprocess.run([sys.executable, "-c", script], env={**known, "HOME": str(home)}, check=True, timeout=120)
    assert not [file for file in home.rglob("*") if "onnxruntime" in str(file)]


class HandlerError(Exception):
    """Raised by a handler of signals."""


def test_what_a_handler_of_signals_raises_is_not_of_the_network(written, monkeypatch):
    """As a time limit of the program that calls; the network ends then, too."""
    onnx = pytest.importorskip("onnx")
    session = open_network(*written(long_network(onnx)), needed_by="this")

    def stop(number, frame):
        raise HandlerError

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, 0.3)
    try:
        with pytest.raises(HandlerError):
            run_network(session, np.zeros((1, 3), np.float32))
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
