"""The paper's update law in every setting, run as a study."""
