"""The overflow of the paper's update law, Eq. (46), and user-defined learning laws."""
