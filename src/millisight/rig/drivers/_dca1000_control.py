"""A DCA1000's command port: requests, answers in time, and what the card tells unasked."""

import socket
import time

from millisight.core.errors import DeviceError
from millisight.rig._dca1000_wire import ALARMS, HARMLESS, Code, parse_reply, request

_TRIES = 3
_PATIENCE = 0.8  # for one answer [s]: three tries are over within 5 s
_ANSWER = 64


class CommandPort:
    """The UDP port through which the card is told what to do.

    Parameters
    ----------
    address, port : of the card
    host, host_port : of this computer, where the card is set up to send its answers; host_port 0: a free one
    """

    def __init__(self, address: str, port: int, host: str, host_port: int):
        self._name = f"the DCA1000 at {address}:{port}"
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._alarms: list[int] = []
        try:
            self._socket.bind((host, host_port))
            self._socket.connect((address, port))
        except OSError as error:
            self._socket.close()
            raise DeviceError(
                f"cannot use {host}:{host_port} to reach {self._name}: {error.strerror}; give this computer's network "
                f"card the address {host}, mask 255.255.255.0, and close mmWave Studio and other programs that use it"
            ) from error

    def command(self, code: Code, data: bytes = b"", *, tries: int = _TRIES) -> int:
        """Send a command, up to `tries` times; the status of the card's answer.

        Raises
        ------
        DeviceError
            It does not answer.
        """
        for _ in range(tries):
            try:
                self._socket.send(request(code, data))
                until = time.monotonic() + _PATIENCE
                while (left := until - time.monotonic()) > 0:
                    self._socket.settimeout(left)
                    answer = self._take()
                    if answer is not None and answer[0] == code:
                        return answer[1]
            except ConnectionRefusedError:
                time.sleep(0.1)
            except TimeoutError:
                pass
            except OSError as error:
                raise DeviceError(f"cannot reach {self._name}: {error.strerror}; check the network cable") from error
        raise DeviceError(
            f"{self._name} does not answer {code.name}; check its power, the network cable, its address, and that "
            "this computer has the address that the card sends to"
        )

    def order(self, code: Code, data: bytes = b"") -> None:
        """Send a command that the card must accept.

        Raises
        ------
        DeviceError
            It does not answer, or refuses.
        """
        status = self.command(code, data)
        if status:
            raise DeviceError(
                f"{self._name} refuses {code.name} (status {status}); switch it off and on, then try again"
            )

    def alarms(self) -> list[str]:
        """What the card told of errors since the last call."""
        self._socket.settimeout(0.0)
        try:
            while True:
                self._take()
        except OSError:  # nothing more is there
            pass
        told, self._alarms = self._alarms, []
        return [ALARMS[bit] for bit in dict.fromkeys(told) if bit not in HARMLESS]

    def close(self) -> None:
        self._socket.close()

    def _take(self) -> tuple[int, int] | None:
        """One answer; what the card tells unasked is kept."""
        answer = parse_reply(self._socket.recv(_ANSWER))
        if answer is not None and answer[0] == Code.SYSTEM_ERROR:
            self._alarms += [bit for bit in range(len(ALARMS)) if answer[1] >> bit & 1]
        return answer
