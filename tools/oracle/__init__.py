"""Parts of ``tools/conformance.py``: what libaom's inspection hook saw, beside what we see."""
