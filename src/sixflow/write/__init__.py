"""Writing fields, whole or not at all, and reading them back.

| suffix | file | read by |
|---|---|---|
| .nc | netCDF-4 | xarray, MATLAB, ParaView, Panoply, R … |
| .zarr | Zarr v3 folder | xarray, for long recordings |
| .csv | text, one row per point and time | spreadsheets; not read back |
"""

from sixflow.write.fieldfile import open_field as open_field
from sixflow.write.fieldfile import write_field as write_field
from sixflow.write.recording import RecordingWriter as RecordingWriter
from sixflow.write.target import check_output as check_output

__all__ = ["RecordingWriter", "check_output", "open_field", "write_field"]
