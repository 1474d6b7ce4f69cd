"""What all GenICam cameras share: settings by name that are read back, frames that the camera numbers itself.

A maker's library is behind `device.Device`, a page of code; `producer` is the one for any GenTL producer.
"""
