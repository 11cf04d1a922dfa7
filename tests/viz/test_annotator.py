"""The annotator without its page: what lies where on the screen, what is answered and saved, and who is refused."""

import base64
import http.client
import json
import socket
import struct
import subprocess
import sys
import threading
import time
import zlib
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import pytest
from PIL import Image

import millisight as ms
from helpers.annotating import Discs, radar_image
from helpers.commands import refused
from helpers.processes import files_to_open
from millisight.cli.annotate import _beside
from millisight.cli.segment import segment
from millisight.core.errors import DamagedFileError, FileError, FormatError, InputError, UnknownNameError
from millisight.data import CameraFrame, Intrinsics, Picture, Prompts
from millisight.io import load_extras
from millisight.io.mito import write_published
from millisight.perception.segmentation import segmenter
from millisight.viz import MOST_WAITING, _page_server
from millisight.viz.annotator import Annotation, AnnotatorServer, OpenedPicture, open_picture, segmenters_for
from millisight.viz.annotator._coarse import Coarse


@pytest.fixture(scope="module")
def radar_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("radar") / "mug.image.h5"
    ms.save(path, radar_image())
    return path


@pytest.fixture
def annotation(radar_file, tmp_path):
    return Annotation(open_picture(radar_file), tmp_path / "mug.mask.h5", segmenters={"discs": Discs()})


def photo(path, pixels, **settings):
    Image.fromarray(pixels).save(path, **settings)
    return path


def asked(points, positive, method="discs"):
    return {"method": method, "points": points, "positive": positive}


def bits(answer, subject):
    columns, rows = subject.size
    packed = np.frombuffer(base64.b64decode(answer["bits"]), np.uint8)
    return np.unpackbits(packed)[: rows * columns].reshape(rows, columns).astype(bool)


class TestTheScreen:
    def test_x_runs_right_and_y_up(self, radar_file):
        subject = open_picture(radar_file)
        image = radar_image()
        assert subject.is_radar
        assert subject.size == image.grid.shape[:2]
        i, j = np.unravel_index(np.argmax(subject.picture.power), subject.picture.shape)
        ((column, row),) = subject.on_screen([[i, j]])
        assert (column, row) == (i, image.grid.shape[1] - 1 - j)
        shown = subject.shown(subject.picture.power)
        assert shown.shape == subject.size[::-1]
        assert np.unravel_index(np.argmax(shown), shown.shape) == (row, column)
        np.testing.assert_array_equal(subject.coloured("jet")[row, column], subject.picture.rgb[i, j])

    def test_a_photo_is_shown_as_it_is(self, tmp_path):
        pixels = np.random.default_rng(0).integers(0, 256, (6, 9, 3)).astype(np.uint8)
        subject = open_picture(photo(tmp_path / "a.png", pixels))
        assert subject.size == (9, 6)
        np.testing.assert_array_equal(subject.coloured("jet"), pixels)
        np.testing.assert_array_equal(subject.on_screen([[5, 8]]), [[8, 5]])

    @pytest.mark.parametrize("kind", ["radar", "photo"])
    def test_places_and_pixels_are_one_to_one(self, kind, radar_file, tmp_path):
        subject = open_picture(
            radar_file if kind == "radar" else photo(tmp_path / "a.png", np.zeros((6, 9, 3), np.uint8))
        )
        points = np.argwhere(np.ones(subject.picture.shape, bool))
        places = subject.on_screen(points)
        assert len(points) > 50
        assert (places >= 0).all()
        assert (places < subject.size).all()
        np.testing.assert_array_equal(subject.on_picture(places), points)


class TestOpening:
    def test_the_published_pickles(self, tmp_path):
        places = ["processed/radars/77_ghz/processed_image.pkl", "unprocessed/camera/continuous.pkl"]
        paths = [tmp_path / "025_mug/robot_collected/0_0_0/exp1/los" / place for place in places]
        seen = np.zeros((480, 640, 3), np.uint8)
        frame = CameraFrame(rgb=seen, depth=seen[..., 0], pose=np.eye(4), intrinsics=Intrinsics.published())
        for path, record in zip(paths, (radar_image(), frame), strict=True):
            path.parent.mkdir(parents=True)
            write_published(path, record)
        radar, camera = map(open_picture, paths)
        assert (radar.is_radar, camera.is_radar) == (True, False)
        assert radar.size == (24, 16)
        assert camera.size == (640, 480)
        assert radar.origin == f"025_mug/robot_collected/0_0_0/exp1/los/{places[0]}"

    def test_photos_of_every_kind(self, tmp_path):
        red = np.full((4, 6, 3), (200, 10, 10), np.uint8)
        assert open_picture(photo(tmp_path / "a.jpg", red)).size == (6, 4)
        turned = Image.Exif()
        turned[0x0112] = 6  # held upright
        assert open_picture(photo(tmp_path / "b.jpeg", red, exif=turned)).size == (4, 6)
        clear = np.dstack([red, np.zeros((4, 6), np.uint8)])
        assert (open_picture(photo(tmp_path / "c.png", clear)).picture.rgb == 255).all()
        deep = np.linspace(0, 60000, 24).reshape(4, 6).astype(np.uint16)
        rgb = open_picture(photo(tmp_path / "d.png", deep)).picture.rgb
        assert (rgb[0, 0, 0], rgb[-1, -1, 0]) == (0, 255)

    def test_what_is_no_picture(self, tmp_path, radar_file):
        cases = [("no.png", None, FileError, "no such file")]
        cases += [("text.png", b"hello", FormatError, "not a PNG or JPEG"), ("a.txt", b"hello", FormatError, "a.txt")]
        whole = photo(tmp_path / "whole.png", np.zeros((64, 64, 3), np.uint8)).read_bytes()
        cases += [("cut.png", whole[:60], DamagedFileError, "cut.png is damaged")]
        huge = b"\x89PNG\r\n\x1a\n"
        for name, body in ((b"IHDR", struct.pack(">IIBBBBB", 60_000, 60_000, 8, 2, 0, 0, 0)), (b"IDAT", b"")):
            huge += struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))
        cases += [("huge.png", huge, InputError, "huge.png has more than")]
        alike = photo(tmp_path / "alike.png", np.zeros((4100, 4100), np.uint8)).read_bytes()
        assert len(alike) < 50_000  # which would take ten times as much memory as 4 MB of them should
        cases += [("alike.png", alike, InputError, r"alike.png has more than 1.6e\+07 pixels")]
        for name, content, error, said in cases:
            if content is not None:
                (tmp_path / name).write_bytes(content)
            with pytest.raises(error, match=said):
                open_picture(tmp_path / name)
        ms.save(tmp_path / "grid.h5", radar_image().grid)
        with pytest.raises(FormatError, match="holds a VoxelGrid, which is not a picture"):
            open_picture(tmp_path / "grid.h5")
        with open(tmp_path / "long.h5", "wb") as file:
            file.truncate(4 << 30)  # holes take no room
        with pytest.raises(FileError, match=r"long\.h5 has 4\.3 GB; files are read whole, up to 1\.1 GB"):
            open_picture(tmp_path / "long.h5")
        with pytest.raises(InputError, match="photograph, which has no other band"):
            open_picture(tmp_path / "whole.png", other_band=radar_file)


class TestTheSession:
    def test_answers_are_the_segmenters_on_the_screen(self, annotation):
        column, row = 7, 3
        answer = annotation.mask(asked([[column, row]], [True]))
        shown = bits(answer, annotation.subject)
        assert shown[row, column]
        assert answer["pixels"] == shown.sum() > 4
        point = annotation.subject.on_picture([[column, row]])
        prompts = Prompts(points=point, positive=np.array([True]))
        expected = Discs().segment(annotation.subject.picture, prompts).masks[0]
        np.testing.assert_array_equal(shown, annotation.subject.shown(expected))
        spacing = annotation.subject.spacing
        assert answer["area"] == pytest.approx(shown.sum() * spacing[0] * spacing[1])

    def test_no_points_no_mask(self, annotation):
        assert annotation.mask(asked([], []))["pixels"] == 0
        assert not annotation.unsaved
        annotation.save(asked([], []))
        assert not ms.load(annotation.mask_path).inside.any()
        later = Annotation(annotation.subject, annotation.mask_path, segmenters={"discs": Discs()})
        assert later.about()["question"]["points"] == []

    def test_the_masks_rule_warns_and_shows(self, annotation):
        many = [[column, row] for column in range(0, 24, 4) for row in range(0, 16, 4)]
        answer = annotation.mask(asked(many, [True] * len(many)))
        assert "right-click what does not belong" in answer["note"]
        assert answer["pixels"] > 300

    def test_mask_and_points_are_saved_and_gone_on_from(self, annotation, radar_file):
        annotation.mask(asked([[5, 5]], [True]))
        assert annotation.unsaved
        question = asked([[5, 5], [9, 5]], [True, False])
        annotation.save(question)
        assert not annotation.unsaved
        mask = ms.load(annotation.mask_path)
        shown = bits(annotation.mask(question), annotation.subject)
        np.testing.assert_array_equal(annotation.subject.shown(mask.inside), shown)
        assert mask.inside.any()
        np.testing.assert_array_equal(mask.grid_xy.x, radar_image().grid.x)
        told = json.loads(annotation.prompts_path.read_text())
        assert load_extras(annotation.mask_path)["segmentation"] == told
        assert (told["method"], told["image"], told["mask"]) == ("discs", "mug.image.h5", "mug.mask.h5")
        assert told["image_sha256"] == annotation.subject.sha256
        prompts = Prompts.from_plain({name: told[name] for name in ("points", "positive")})
        np.testing.assert_array_equal(annotation.subject.on_screen(prompts.points), question["points"])
        later = Annotation(open_picture(radar_file), annotation.mask_path, segmenters={"discs": Discs()})
        assert later.about()["question"] == question
        assert later.about()["saved"]
        annotation.mask_path.unlink()
        later = Annotation(open_picture(radar_file), annotation.mask_path, segmenters={"discs": Discs()})
        assert later.about()["question"] == question
        assert not later.about()["saved"]

    def test_the_saved_points_make_the_same_mask_on_the_command_line(self, radar_file, tmp_path):
        annotation = Annotation(
            open_picture(radar_file), tmp_path / "mug.mask.h5", segmenters={"classical": segmenter("classical")}
        )
        annotation.save(asked([[17, 11], [2, 2]], [True, False], "classical"))
        again = tmp_path / "again.mask.h5"
        segment([radar_file], output=again, method="classical", prompts=annotation.prompts_path, no_picture=True)
        masks = [ms.load(path).inside for path in (annotation.mask_path, again)]
        assert masks[0].any()
        np.testing.assert_array_equal(*masks)

    def test_a_photos_mask_is_a_picture(self, tmp_path):
        path = photo(tmp_path / "a.png", np.full((30, 40, 3), 90, np.uint8))
        annotation = Annotation(open_picture(path), tmp_path / "a.mask.png", segmenters={"discs": Discs()})
        annotation.save(asked([[20, 10]], [True]))
        saved = np.asarray(Image.open(tmp_path / "a.mask.png"))
        assert saved.shape == (30, 40)
        assert saved[10, 20] == 255
        assert set(np.unique(saved)) == {0, 255}
        assert json.loads((tmp_path / "a.prompts.json").read_text())["points"] == [[10, 20]]

    def test_other_peoples_prompts_are_not_overwritten(self, radar_file, tmp_path):
        for text in ('{"image_sha256": "0", "image": "cup.h5"}', "[1]", "no json", '{"points": []}', "[" * 99999):
            (tmp_path / "mug.prompts.json").write_text(text)
            with pytest.raises(FileError, match="would be overwritten"):
                Annotation(open_picture(radar_file), tmp_path / "mug.mask.h5", segmenters={"discs": Discs()})

    def test_what_cannot_be_asked(self, annotation):
        cases = [
            (None, "expected a method"),
            ({"method": "discs"}, "expected a method"),
            (asked([[1, 1]], [1]), "true and false"),
            (asked([[1, 1]], []), "positive has shape"),
            (asked([[-1, 1]], [True]), "point is -1"),
            (asked([[24, 1]], [True]), "not on the picture"),
            (asked([[1.5, 1]], [True]), "point is 1.5"),
            (asked([1, 2], [True, True]), "pairs"),
            (asked([[1, 1]] * 1001, [True] * 1001), "1000 at most"),
        ]
        for value, said in cases:
            with pytest.raises(InputError, match=said):
                annotation.mask(value)
        for method in ("disks", None, ["discs"]):
            with pytest.raises(UnknownNameError):
                annotation.mask(asked([[1, 1]], [True], method))
        with pytest.raises(UnknownNameError):
            annotation.picture("rainbow")

    def test_what_is_offered(self, radar_file, tmp_path):
        subjects = open_picture(radar_file), open_picture(photo(tmp_path / "a.png", np.zeros((9, 9, 3), np.uint8)))
        radar, seen = map(segmenters_for, subjects)
        assert list(radar) == list(seen) == ["wave", "classical", "sam"]
        assert [name for name, by in seen.items() if not isinstance(by, str)] == ["classical"]
        assert "radar images only" in seen["wave"]
        assert "--model" in radar["sam"]
        answer = Annotation(subjects[0], tmp_path / "m.h5", segmenters=radar).mask(
            asked([[17, 11]], [True], "classical")
        )
        assert answer["pixels"] > 0

    def test_segmenters_that_cannot_work_say_why(self, radar_file, tmp_path):
        subject = open_picture(radar_file)
        annotation = Annotation(subject, tmp_path / "m.h5", segmenters={"big": "needs a model", "discs": Discs()})
        assert annotation.about()["question"]["method"] == "discs"
        assert annotation.about()["methods"][0] == {"name": "big", "hindrance": "needs a model"}
        with pytest.raises(InputError, match="big cannot be used: needs a model"):
            annotation.mask(asked([], [], "big"))
        with pytest.raises(InputError, match="big cannot be used"):
            Annotation(subject, tmp_path / "m.h5", segmenters=annotation._segmenters, method="big")
        with pytest.raises(InputError, match="no segmenter can be used: needs a model"):
            Annotation(subject, tmp_path / "m.h5", segmenters={"big": "needs a model"})

    def test_a_mask_goes_into_a_file_of_its_kind(self, radar_file, tmp_path):
        with pytest.raises(InputError, match=r"mug.png; expected a name that ends in .h5"):
            Annotation(open_picture(radar_file), tmp_path / "mug.png", segmenters={"discs": Discs()})


class TestTheCommand:
    def test_what_cannot_begin_is_said_in_a_line(self, tmp_path):
        (tmp_path / "cup.png").write_bytes(b"no picture")
        assert "cup.png is not a PNG or JPEG picture" in refused("annotate", "cup.png", cwd=tmp_path)
        photo(tmp_path / "cup.png", np.zeros((9, 9, 3), np.uint8))
        with socket.create_server(("127.0.0.1", 0)) as taken:
            port = taken.getsockname()[1]
            assert f"cannot bind port {port}" in refused("annotate", "cup.png", "--port", port, cwd=tmp_path)

    @pytest.mark.parametrize(
        ("place", "name"),
        [
            ("here/mug.image.h5", "here/mug.mask.h5"),
            (
                "025_mug/robot_collected/0_0_0/exp1/los/processed/radars/77_ghz/processed_image_edges.pkl",
                "025_mug.0_0_0.exp1.los.77_ghz_edges.mask.h5",
            ),
        ],
    )
    def test_the_masks_name_is_that_of_segment(self, place, name, radar_file):
        subject = OpenedPicture(path=Path(place), sha256="", picture=open_picture(radar_file).picture)
        assert _beside(subject) == Path(name)


class TestCoarse:
    def test_masks_are_of_blocks_at_their_place(self):
        picture = Picture(rgb=np.zeros((31, 50, 3), np.uint8))
        coarse = Coarse(Discs(), 200)  # blocks of 3
        prompts = Prompts(points=np.array([[30, 49], [4, 4]]), positive=np.array([True, False]))
        (mask,) = coarse.segment(picture, prompts).masks
        assert mask.shape == (31, 50)
        assert mask[30, 49]
        assert mask[21, 48]  # a disc of three pixels, each three wide
        assert not mask[20, 48]
        assert (mask[:30:3, :48:3] == mask[2:30:3, 2:48:3]).all()

    def test_a_small_picture_is_seen_whole(self):
        picture = Picture(rgb=np.zeros((10, 20, 3), np.uint8))
        prompts = Prompts(points=np.array([[5, 5]]), positive=np.array([True]))
        seen = [by.segment(picture, prompts).masks for by in (Coarse(Discs(), 200), Discs())]
        np.testing.assert_array_equal(*seen)


class TestTheServer:
    @pytest.fixture
    def server(self, annotation):
        with AnnotatorServer(annotation) as server:
            yield server

    def get(self, server, path, *, method="GET", body=None, **headers):
        connection = http.client.HTTPConnection("127.0.0.1", server.server_address[1], timeout=10)
        try:
            connection.request(method, path, body=body, headers={k.replace("_", "-"): v for k, v in headers.items()})
            reply = connection.getresponse()
            return reply.status, dict(reply.getheaders()), reply.read()
        finally:
            connection.close()

    def test_the_page_fetches_nothing_from_elsewhere(self, server):
        root = urlsplit(server.address).path
        for name in ("", "page.css", "page.js", "drawing.js"):
            status, headers, content = self.get(server, root + name)
            assert status == 200
            assert "default-src 'none'" in headers["Content-Security-Policy"]
            assert content
            assert b"http" not in content
        assert server.server_address[0] == "127.0.0.1"

    def test_only_the_page_itself_may_ask(self, server):
        root = urlsplit(server.address).path
        assert self.get(server, root + "about")[0] == 200
        refused = [
            self.get(server, "/about"),
            self.get(server, "/wrong/about"),
            self.get(server, "/%ff/about"),
            self.get(server, root + "about", Host="evil.example"),  # rebinding
            self.get(server, root + "about", Origin="http://evil.example"),
            self.get(server, root + "save", method="POST", body="{}", Origin="null"),
        ]
        assert [status for status, _, _ in refused] == [403] * len(refused)
        port = server.server_address[1]
        assert self.get(server, root + "about", Origin=f"http://127.0.0.1:{port}")[0] == 200

    @pytest.mark.parametrize("head", [
        "Host: {0}\r\nHost: evil.example", "Host: {0}\r\nOrigin: http://{0}\r\nOrigin: http://evil.example",
        "Host: {0}\r\nOrigin : http://evil.example", "X: 1",
    ])  # fmt: skip
    def test_headers_that_come_twice_or_oddly_are_refused(self, head, server):
        root, name = urlsplit(server.address).path, f"127.0.0.1:{server.server_address[1]}"
        assert self.raw(server, f"GET {root}about HTTP/1.1\r\n{head.format(name)}\r\n\r\n").startswith(b"HTTP/1.1 403 ")
        other = f"GET http://evil.example{root}about HTTP/1.1\r\nHost: {name}\r\n\r\n"
        assert self.raw(server, other).startswith(b"HTTP/1.1 403 ")

    @pytest.mark.parametrize("line", ["PUT {} HTTP/1.1", "GET " + "a" * 66_000])
    def test_answers_of_the_library_have_the_policy(self, line, server):
        answer = self.raw(server, f"{line.format(urlsplit(server.address).path)}\r\nHost: 127.0.0.1\r\n\r\n")
        assert b"\r\nContent-Security-Policy: default-src 'none'" in answer

    def raw(self, server, request):
        with socket.create_connection(server.server_address, timeout=10) as page:
            page.sendall(request.encode())
            return page.recv(2000)

    def test_a_page_stays_open_beside_a_thousand_connections(self, server):
        resource = pytest.importorskip("resource")
        before = resource.getrlimit(resource.RLIMIT_NOFILE)
        resource.setrlimit(resource.RLIMIT_NOFILE, (min(5000, before[1]), before[1]))
        held = []
        try:
            held = [socket.create_connection(server.server_address, timeout=10) for _ in range(600)]  # two numbers each
            root = urlsplit(server.address).path
            held.append(page := socket.create_connection(server.server_address, timeout=10))
            page.sendall(f"GET {root}open HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n".encode())
            answer = b""
            while not answer.endswith(b": open\n\n"):
                answer += page.recv(2000)
            assert answer.startswith(b"HTTP/1.1 200 ")
            page.settimeout(0.5)
            with pytest.raises(TimeoutError):
                page.recv(100)
        finally:
            for one in held:
                one.close()
            resource.setrlimit(resource.RLIMIT_NOFILE, before)

    def test_connections_that_ask_nothing_keep_nobody_out(self, server):
        """Beyond a number the oldest ends, so that no files are left to open for the page."""
        script = (
            "import socket, sys; here = '127.0.0.1', int(sys.argv[1]); sys.stdin.readline(); "
            "held = [socket.create_connection(here, 10) for _ in range(400)]; "
            "print('held', flush=True); sys.stdin.read()"
        )
        asked = [sys.executable, "-c", script, str(server.server_address[1])]
        with subprocess.Popen(asked, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
            with files_to_open(2 * MOST_WAITING + 30):  # of this process, not of the other
                other.stdin.write(b"go\n")
                other.stdin.flush()
                assert other.stdout.readline() == b"held\n"
                assert self.get(server, urlsplit(server.address).path + "about")[0] == 200
            other.stdin.close()

    def test_an_address_that_cannot_be_split_is_answered(self, server):
        for target in ("http://[/x", "//[/x"):
            with socket.create_connection(server.server_address, timeout=10) as page:
                page.sendall(f"GET {target} HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n".encode())
                assert page.recv(100).startswith(b"HTTP/1.1 403 ")

    def test_nonsense_is_answered(self, server):
        root = urlsplit(server.address).path
        assert self.get(server, root + "../../etc/passwd")[0] == 404
        assert self.get(server, root + "picture/rainbow")[0] == 422
        assert self.get(server, root + "other", method="POST", body="{}")[0] == 404
        for body in ("no json", "[" * 99999):
            assert self.get(server, root + "mask", method="POST", body=body)[0] == 400
        for length in ("1048577", "-1", "many"):
            assert self.get(server, root + "mask", method="POST", body="", Content_Length=length)[0] == 400
        status, _, content = self.get(server, root + "mask", method="POST", body="{}")
        assert status == 422
        assert "reload" in json.loads(content)["error"]

    @pytest.mark.parametrize("begun", ["GET {}about HT", "POST {}mask HTTP/1.1\r\n{}\r\nContent-Length: 9\r\n\r\n1"])
    def test_a_page_that_stops_in_the_middle_of_a_request_is_hung_up_on(self, begun, server, monkeypatch, capsys):
        monkeypatch.setattr(_page_server._Handler, "timeout", 0.3)
        with socket.create_connection(server.server_address, timeout=10) as page:
            page.sendall(begun.format(urlsplit(server.address).path, "Host: 127.0.0.1").encode())
            assert page.recv(100) == b""
        assert capsys.readouterr().err == ""
        assert self.get(server, urlsplit(server.address).path + "about")[0] == 200

    @pytest.mark.parametrize("begun", ["GET {}about HT", "POST {}mask HTTP/1.1\r\n{}\r\nContent-Length: 99\r\n\r\n1"])
    def test_a_page_that_drips_a_request_is_hung_up_on(self, begun, server, monkeypatch, capsys):
        monkeypatch.setattr(_page_server._Handler, "timeout", 0.4)
        with socket.create_connection(server.server_address, timeout=0.1) as page:
            page.sendall(begun.format(urlsplit(server.address).path, "Host: 127.0.0.1").encode())
            for _ in range(30):  # for 3 s, a byte each 0.1 s
                try:
                    assert page.recv(100) == b""
                    break
                except TimeoutError:
                    page.sendall(b"1")
                except ConnectionError:  # bytes that it has not read any more
                    break
            else:
                pytest.fail("it was listened to for 3 s")
        assert capsys.readouterr().err == ""
        assert self.get(server, urlsplit(server.address).path + "about")[0] == 200

    @pytest.mark.parametrize("sent", ["", "GET {}about HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"])
    def test_a_page_that_asks_nothing_more_is_hung_up_on_without_a_word(self, sent, server, monkeypatch, capsys):
        monkeypatch.setattr(_page_server._Handler, "timeout", 0.3)
        with socket.create_connection(server.server_address, timeout=5) as page:
            page.sendall(sent.format(urlsplit(server.address).path).encode())
            while page.recv(4096):
                pass
        time.sleep(0.1)
        assert capsys.readouterr().err == ""

    def test_a_taken_port_is_said(self, annotation, server):
        with pytest.raises(InputError, match=r"cannot bind port \d+ of 127.0.0.1: .*--port"):
            AnnotatorServer(annotation, server.server_address[1])

    def test_it_ends_when_the_last_page_is_closed(self, server):
        waiting = threading.Thread(target=server.wait, kwargs={"until_closed": True, "grace": 0.2}, daemon=True)
        waiting.start()
        for _ in range(2):  # a page that is loaded anew is no page closed
            with socket.create_connection(server.server_address) as page:
                page.sendall(f"GET {urlsplit(server.address).path}open HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n".encode())
                assert b"text/event-stream" in page.recv(4096)
                waiting.join(0.5)
                assert waiting.is_alive()
        waiting.join(5)
        assert not waiting.is_alive()


def test_killed_between_mask_and_points_the_mask_is_marked_as_made_by_hand(annotation, radar_file, monkeypatch):
    """It was overwritten by `segment`, and where there were older points, these were called saved."""
    annotation.save(asked([[5, 5]], [True]))

    def killed(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(Annotation, "_write", killed)
    with pytest.raises(KeyboardInterrupt):
        annotation.save(asked([[9, 5]], [True]))
    monkeypatch.undo()
    assert annotation.prompts_path.exists()
    later = Annotation(open_picture(radar_file), annotation.mask_path, segmenters={"discs": Discs()})
    assert later.about()["question"] == asked([[9, 5]], [True])
    assert not later.about()["saved"]
    assert later.unsaved
    later.save(asked([[9, 5]], [True]))
    assert Annotation(open_picture(radar_file), annotation.mask_path, segmenters={"discs": Discs()}).about()["saved"]
