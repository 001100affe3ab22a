"""The page in a real browser: every plot draws, the 3-D view moves, nothing fails, nothing is fetched."""

import json
import re
import shutil
import subprocess
from html import unescape

import pytest
from pages import N_FIGURES, full_report

from flexplant.report import render

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on the path (Debian: apt install chromium)")

FLAGS = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-dev-shm-usage",
    "--hide-scrollbars",
    "--window-size=1400,900",
    "--virtual-time-budget=40000",
    "--dump-dom",
]
HOSTILE = "</script><script>window.hacked=1</script><img src=x onerror=hacked=1><a href='https://example.org'>l</a>\"'& "

LISTEN = """<script>
window.refused = [];
document.addEventListener("securitypolicyviolation", (e) => refused.push(e.violatedDirective + " " + e.blockedURI));
</script>"""

PROBE = """<script>
(async () => {
  const root = document.documentElement, pause = (ms) => new Promise((done) => setTimeout(done, ms));
  while (!root.dataset.state) await pause(100);
  const canvas = document.querySelector("canvas"), view = document.querySelector(".structure");
  const picture = () => canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
  const painted = () => { const p = picture(); let n = 0; for (let i = 3; i < p.length; i += 4) n += p[i] > 0; return n; };
  const same = (a, b) => a.length === b.length && a.every((v, i) => v === b[i]);
  canvas.scrollIntoView();
  // frames are rare while the clock is virtual
  const first = picture();
  let moved = false;
  for (let i = 0; i < 50 && !moved; i++) { await pause(200); moved = !same(first, picture()); }
  view.querySelector(".play").click();
  await pause(2500);
  const still = picture();
  await pause(2500);
  const stopped = same(still, picture());
  const list = view.querySelector(".mode");
  list.value = "1";
  list.dispatchEvent(new Event("change"));
  const otherMode = !same(still, picture());
  const turned = picture();
  view.querySelector("[data-view=z]").click();
  const otherView = !same(turned, picture());
  const result = {
    state: root.dataset.state, errors: root.dataset.errors ?? "", trouble: !document.getElementById("trouble").hidden,
    plots: Number(root.dataset.plots), views: Number(root.dataset.views),
    drawn: [...document.querySelectorAll(".drawing")].map((d) => d.querySelectorAll(".main-svg .trace path").length),
    modes: list.length, painted: painted(), moved, stopped, otherMode, otherView, title: document.title, refused,
    hacked: window.hacked ?? null, images: document.images.length, links: document.querySelectorAll("a:not([href^='#'])").length,
    here: document.querySelectorAll("nav a.here").length, width: document.documentElement.scrollWidth - innerWidth,
    fetched: performance.getEntriesByType("resource").map((entry) => entry.name),
  };
  const place = document.createElement("pre");
  place.id = "probe";
  place.textContent = JSON.stringify(result);
  document.body.append(place);
})();
</script>"""


def looked_at(html: str, folder) -> dict:
    """What a probe inside the page saw once everything was drawn."""
    file = folder / "report.html"
    page = html.replace("<style>", LISTEN + "<style>", 1)
    head, tail = page.rsplit("</body>", 1)
    file.write_text(head + PROBE + "</body>" + tail, encoding="utf-8")
    command = [CHROMIUM, *FLAGS, f"--user-data-dir={folder / 'profile'}", file.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=180, check=False)
    found = re.search(r'<pre id="probe">(.*?)</pre>', done.stdout, flags=re.DOTALL)
    assert found, f"the page did not finish; Chromium said: {done.stderr[-2000:]}"
    return json.loads(unescape(found.group(1)))


@pytest.fixture(scope="module")
def seen(tmp_path_factory) -> dict:
    return looked_at(render(full_report()), tmp_path_factory.mktemp("page"))


def test_everything_is_drawn_without_an_error(seen):
    assert (seen["state"], seen["errors"], seen["trouble"]) == ("ready", "", False)
    assert (seen["plots"], seen["views"]) == (N_FIGURES, 1)
    assert len(seen["drawn"]) == N_FIGURES
    assert min(seen["drawn"]) >= 1


def test_the_structure_is_visible_moves_stops_and_turns(seen):
    assert seen["painted"] > 20_000
    assert seen["modes"] == 2
    assert [seen[k] for k in ("moved", "stopped", "otherMode", "otherView")] == [True] * 4


def test_nothing_is_fetched_or_refused(seen):
    assert seen["refused"] == []
    assert seen["fetched"] == []
    assert seen["links"] == 0


def test_the_page_fits_the_window_and_marks_its_place(seen):
    assert seen["width"] <= 0
    assert seen["here"] == 1


def test_hostile_names_do_nothing_in_the_browser(tmp_path):
    seen = looked_at(render(full_report(lambda text: HOSTILE + text)), tmp_path)
    assert (seen["state"], seen["errors"], seen["hacked"], seen["refused"]) == ("ready", "", None, [])
    assert (seen["images"], seen["links"]) == (0, 0)
    assert seen["title"].startswith("</script>")
