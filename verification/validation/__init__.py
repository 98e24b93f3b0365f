"""The model compared with what others have printed and released."""
