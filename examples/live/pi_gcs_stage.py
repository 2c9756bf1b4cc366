"""A stage on a controller that speaks PI's General Command Set. Written from the package's documentation and not tried
on hardware.

Needs the package ``pipython``. The controller's own servo is off: the drive is its open-loop voltage.
"""

from pipython import GCSDevice


class GcsStage:
    """Axis 1 of an E-709 on USB."""

    input_unit, output_unit = "V", "um"
    x_limits, y_range = (0.0, 100.0), (0.0, 100.0)
    rate_limit, rest = 500.0, 0.0
    controller, serial, axis = "E-709", "0123456789", "1"

    def open(self) -> None:
        """Connect."""
        self._device = GCSDevice(self.controller)
        self._device.ConnectUSB(serialnum=self.serial)
        self._device.SVO(self.axis, False)

    def exchange(self, x: float) -> float:
        """Write the drive and return the measured output."""
        self._device.SVA(self.axis, x)
        return self._device.qPOS(self.axis)[self.axis]

    def close(self) -> None:
        """Disconnect."""
        self._device.CloseConnection()
