"""Execute notebooks and store their outputs in them, without times: FILE.ipynb ..."""

import sys

import nbclient
import nbformat

for path in sys.argv[1:]:
    notebook = nbformat.read(path, 4)
    client = nbclient.NotebookClient(notebook, timeout=120, record_timing=False)
    nbformat.write(client.execute(), path)
