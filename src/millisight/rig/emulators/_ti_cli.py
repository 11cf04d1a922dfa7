"""The command line of a TI board in software, on a pseudo-terminal."""

from collections.abc import Callable

from millisight.rig.emulators._line import PseudoLine

_PROMPT = "mmwDemo:/>"
_KNOWN = frozenset(
    (
        "sensorStop", "sensorStart", "flushCfg", "dfeDataOutputMode", "channelCfg", "adcCfg", "adcbufCfg", "profileCfg",
        "chirpCfg", "frameCfg", "lowPower", "guiMonitor", "cfarCfg", "multiObjBeamForming", "clutterRemoval",
        "calibDcRangeSig", "compRangeBiasAndRxChanPhase", "measureRangeBiasAndRxChanPhase", "aoaFovCfg", "cfarFovCfg",
        "extendedMaxVelocity", "CQRxSatMonitor", "CQSigImgMonitor", "analogMonitor", "lvdsStreamCfg", "bpmCfg",
        "calibData", "version",
    )
)  # fmt: skip


class TiCliEmulator:
    """A board that runs a demo of the mmWave SDK.

    Parameters
    ----------
    start : called with the number of frames when frames are to be taken
    stop : called when no more are
    profile : .cfg file with the one waveform that it has, others are refused; None: it takes any, and changes nothing

    Attributes
    ----------
    port : name of the serial line
    lines : that came, in order
    refused : commands that it answers with an error
    silent : it answers no line any more
    """

    def __init__(self, start: Callable[[int], None], stop: Callable[[], None], *, profile: str | None = None):
        self._start, self._stop = start, stop
        lines = (profile or "").splitlines()
        self._waveform = next((_waveform_in(line.split()) for line in lines if line.startswith("profileCfg")), None)
        self.lines: list[str] = []
        self.refused: set[str] = set()
        self.silent: bool = False
        self._frames: int | None = None
        self._running = False
        self._came = b""
        self._line = PseudoLine(self._take)
        self.port: str = self._line.name

    def close(self) -> None:
        self._line.close()

    def _take(self, came: bytes) -> bytes:
        self._came += came
        answers = b""
        while b"\n" in self._came:
            line, _, self._came = self._came.partition(b"\n")
            text = line.decode("ascii", "replace").strip()
            self.lines.append(text)
            if not self.silent:
                answers += f"{text}\r\n{self._answer(text)}\r\n{_PROMPT}".encode("ascii")
        return answers

    def _answer(self, line: str) -> str:
        words = line.split()
        if not words:
            return ""
        if words[0] not in _KNOWN:
            return f"'{words[0]}' is not recognized as a CLI command"
        if words[0] in self.refused:
            return "Error -1"
        if words[0] == "profileCfg" and self._waveform is not None and _waveform_in(words) != self._waveform:
            return "Error -1: the emulated radar has another waveform"
        if words[0] == "version":
            return "Platform                : emulator\r\nmmWave SDK Version      : 03.06.00.00\r\nDone"
        if words[0] == "flushCfg":
            self._frames = None
        if words[0] == "frameCfg":
            self._frames = int(words[4])
        if words[0] == "sensorStop":
            if not self._running:
                return "Ignored: Sensor is already stopped\r\nDone"
            self._running = False
            self._stop()
        if words[0] == "sensorStart":
            if self._frames is None:
                return "Error: Full configuration is needed before the sensor starts"
            self._running = True
            self._start(self._frames)
        return "Done"


def _waveform_in(words: list[str]) -> list[str]:
    """Start frequency, slope, samples and sample rate of a profileCfg."""
    return [words[i] for i in (2, 8, 10, 11) if i < len(words)]
