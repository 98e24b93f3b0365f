"""Certificates with correct digests, whatever their content: forgeries."""

import hashlib
import json


def sealed(certificate):
    """Return the text of a certificate whose digest and checksum are those of its content."""
    ends = ("digest", "provenance", "checksum")
    body = {name: value for name, value in certificate.items() if name not in ends}
    head = json.dumps(body)[:-1]
    digest = hashlib.sha256(head.encode()).hexdigest()
    provenance = json.dumps(certificate["provenance"])
    whole = f'{head}, "digest": "{digest}", "provenance": {provenance}'
    checksum = hashlib.sha256(whole.encode()).hexdigest()
    return f'{whole}, "checksum": "{checksum}"}}\n'
