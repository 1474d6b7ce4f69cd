"""The line interface: CAN messages of the DBC, buses, the PLC simulator, the monitor."""
