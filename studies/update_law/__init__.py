"""The overflow of the paper's update law, Eq. (46), and examples of user-defined learning laws."""
