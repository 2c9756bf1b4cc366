"""A stage on an analogue output and input of NI-DAQmx. Written from the package's documentation and not tried on
hardware.

Needs the package ``nidaqmx`` and National Instruments' driver. Software-timed: a few hundred samples a second.
"""

import nidaqmx


class DaqStage:
    """An amplifier with a gain of 15 on ao0, and a sensor of 4 µm/V on ai0."""

    input_unit, output_unit = "V", "um"
    x_limits, y_range = (0.0, 150.0), (-20.0, 20.0)
    rate_limit, rest = 500.0, 0.0
    amplifier, um_per_volt = 15.0, 4.0

    def open(self) -> None:
        """Connect."""
        self._out, self._in = nidaqmx.Task(), nidaqmx.Task()
        self._out.ao_channels.add_ao_voltage_chan("Dev1/ao0", min_val=0.0, max_val=10.0)
        self._in.ai_channels.add_ai_voltage_chan("Dev1/ai0", min_val=-10.0, max_val=10.0)

    def exchange(self, x: float) -> float:
        """Write the drive and return the measured output."""
        self._out.write(x / self.amplifier, auto_start=True)
        return self.um_per_volt * self._in.read()

    def close(self) -> None:
        """Disconnect."""
        self._out.close()
        self._in.close()
