"""The browser that other tests check pages with sees what is wrong with a page."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    from browser import Browser

PNG = "data:image/gif;base64,R0lGODlhAQABAAAAACwAAAAAAQABAAA="


def test_a_page_without_fault_has_none(browser: Browser, tmp_path: Path) -> None:
    page = tmp_path / "good page.html"
    page.write_text(f'<!doctype html><title>Good</title><p>words<img alt="dot" src="{PNG}">')
    found = browser.visit(page)
    assert (found.title, found.text) == ("Good", "words")
    assert (found.complaints, found.requests, found.broken, found.overflow) == ((), (), (), 0)
    assert found.png.startswith(b"\x89PNG")


def test_errors_requests_and_overflow_are_seen(browser: Browser, tmp_path: Path) -> None:
    page = tmp_path / "bad.html"
    page.write_text(
        """<!doctype html><title>Bad</title><div style="width: 2000px">wide</div>
        <img alt="far" src="http://example.com/far.png"><img alt="lost" src="lost.png">
        <script>
        console.error("told", 7);
        setTimeout(() => { undefined_name(); }, 50);
        fetch("https://example.net/later").catch(() => null);
        </script>"""
    )
    found = browser.visit(page, size=(500, 400))
    assert "told 7" in found.complaints
    assert any(text.startswith("ReferenceError: undefined_name") for text in found.complaints)
    assert set(found.requests) == {
        "http://example.com/far.png", (tmp_path / "lost.png").as_uri(), "https://example.net/later",
    }  # fmt: skip
    assert set(found.broken) == {"far", "lost"}
    assert found.overflow >= 1500
