"""mmWave Studio for boards whose demo does not stream over LVDS (xWR12xx, xWR14xx): a Lua script of the same profile.

Studio sets the radar up and starts its frames; the DCA1000's packets are recorded by us. The two meet in a file: when
it appears, the script removes it and starts the frames of one row.
"""

import re
import secrets
import time
from contextlib import suppress
from pathlib import Path

from millisight.core import check_own, printable, quoted, write_text
from millisight.core.errors import DeviceError, FileError, FormatError
from millisight.io.raw import read_ti_config
from millisight.rig.drivers._ti_cli import profile_lines

_PATIENCE = 3.0  # until the script takes the file [s]
_RAMP = 14  # numbers of a profile
_MARK = "asked for by millisight"

_SCRIPT = """\
-- Made by millisight from {profile}: run it in mmWave Studio after "Connect" and the download of the firmware.
-- millisight records the DCA1000's packets itself: leave Studio's own capture off.
local start_file = "{start_file}"

local function must(name, status)
  if status ~= 0 then
    WriteToLog(name .. " failed: " .. tostring(status) .. "\\n", "red")
    error(name .. " failed")
  end
end

must("ChanNAdcConfig", ar1.ChanNAdcConfig({tx}, {rx}, 2, {adc_format}, {iq_swap}))
must("LPModConfig", ar1.LPModConfig(0, 0))
must("RfInit", ar1.RfInit())
RSTD.Sleep(1000)
must("DataPathConfig", ar1.DataPathConfig(513, 1216644097, 0))
must("LvdsClkConfig", ar1.LvdsClkConfig(1, 1))
must("LVDSLaneConfig", ar1.LVDSLaneConfig(0, 1, 1, {more_lanes}, {more_lanes}, 1, 0, 0))
must("ProfileConfig", ar1.ProfileConfig(0, {start}, {idle}, {adc_start}, {ramp_end}, 0, 0, 0, 0, 0, 0, {slope}, \
{tx_start}, {samples}, {rate}, 0, 0, {gain}))
must("ChirpConfig", ar1.ChirpConfig(0, 0, 0, 0, 0, 0, 0, {tx}))
must("FrameConfig", ar1.FrameConfig(0, 0, {frames}, {loops}, {period}, 0, 0, 1))
WriteToLog("ready: start the scan with millisight collect\\n", "green")

while true do
  local file = io.open(start_file, "r")
  if file then
    file:close()
    os.remove(start_file)
    must("StartFrame", ar1.StartFrame())
  end
  RSTD.Sleep(10)
end
"""


def studio_script(profile: Path, *, frames: int, start_file: str, lanes: int = 4) -> str:
    """The Lua script for mmWave Studio that does what `profile` says, and starts `frames` frames on request.

    Parameters
    ----------
    profile : a .cfg file with one profile and one chirp
    frames : of a row
    start_file : the file that asks for a row's frames, as the computer with Studio calls it
    lanes : of LVDS, 4 or 2

    Raises
    ------
    DeviceError
        There are several profiles, or several chirps in a frame, which this script does not write.
    FileError, FormatError
        The profile cannot be read, or cannot be right.
    """
    config = read_ti_config(profile)
    if len(config.tx_masks) != 1:
        raise DeviceError(
            f"{printable(profile.name)} has {len(config.tx_masks)} chirps in a loop; expected 1, as the script for "
            "mmWave Studio has"
        )
    lines = [line.split() for line in profile_lines(profile)]
    ramps = [words[1:] for words in lines if words[0] == "profileCfg"]
    if len(ramps) != 1:
        raise DeviceError(f"{printable(profile.name)} has {len(ramps)} profiles; expected 1, as the script has")
    if len(ramps[0]) < _RAMP:
        raise FormatError(f"{printable(profile.name)}: profileCfg has {len(ramps[0])} numbers; expected {_RAMP}")
    words = {line[0]: line[1:] for line in lines}
    ramp = [_number(word, profile) for word in ramps[0]]
    receivers = int(words["channelCfg"][0])
    return _SCRIPT.format(
        profile=printable(profile.name).replace("\n", " "),
        start_file=start_file.replace("\\", "/").replace('"', ""),
        tx=", ".join(str(config.tx_masks[0] >> i & 1) for i in range(3)),
        rx=", ".join(str(receivers >> i & 1) for i in range(4)),
        adc_format=_number(words["adcCfg"][1], profile),
        iq_swap=int(config.sample_swap),
        more_lanes=int(lanes == 4),
        start=ramp[1], idle=ramp[2], adc_start=ramp[3], ramp_end=ramp[4], slope=ramp[7], tx_start=ramp[8],
        samples=ramp[9], rate=ramp[10], gain=ramp[13],
        frames=frames, loops=config.loops, period=f"{1000 * config.frame_period:.9g}",
    )  # fmt: skip


def _number(word: str, profile: Path) -> str:
    """A number of the profile as it stands there: whatever else it holds would be run by Studio."""
    if re.fullmatch(r"-?\d{1,12}(\.\d{1,12})?", word, re.ASCII) is None:
        raise FormatError(f"{printable(profile.name)}: {quoted(word)} stands where a number is expected")
    return word


class StartFile:
    """Starts a row's frames by a file that the script of `studio_script` waits for."""

    def __init__(self, path: Path):
        self._path, self._asked = path, ""

    def start(self, frames: int) -> None:
        """Ask for the frames of a row; their number is the script's.

        Raises
        ------
        DeviceError
            Nobody takes the file, or another one has its name.
        """
        try:
            check_own(self._path, f" frames, {_MARK}")
            self._asked = f"{frames} frames, {_MARK} {secrets.token_hex(4)}\n"
            write_text(self._path, self._asked)
        except FileError as error:
            raise DeviceError(f"cannot ask mmWave Studio for frames: {error}") from error
        until = time.monotonic() + _PATIENCE
        while self._path.exists():
            if time.monotonic() > until:
                self.close()
                raise DeviceError(
                    f"mmWave Studio did not take {printable(self._path)} within {_PATIENCE:g} s; run the script that "
                    "`millisight rig script` writes in Studio, and give both the same folder"
                )
            time.sleep(0.002)

    def stop(self) -> None:
        """The frames end by themselves."""

    def version(self) -> str:
        return f"started by mmWave Studio through {printable(self._path)}"

    def close(self) -> None:
        """Take the question back, where nobody has."""
        with suppress(OSError):
            if self._asked and self._path.read_bytes() == self._asked.encode():
                self._path.unlink()
