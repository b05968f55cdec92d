"""The page driven by mouse and keys in a headless Chromium, its pixels read back and held against where the body must be seen."""

import csv
import io
import json

import numpy as np
import pytest
from matplotlib import colormaps
from PIL import Image

from physics.view import viewer as module
from physics.view.exhibit import Animation, Exhibit, mode_exhibit, path_exhibit
from physics.view.viewer import section, write_page
from tests.chromium import MISSING, PROGRAM, Chromium
from tests.exhibits import HARD, MESH, RUBBER, bent, exhibits, wrong

browser_needed = pytest.mark.skipif(PROGRAM is None, reason=MISSING)


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "page.html"
    write_page(path, "A & B", exhibits(), {"mesh": "some <nodes>"})
    return path


@pytest.fixture(scope="module")
def chromium():
    found = Chromium(1000, 900)
    yield found
    found.close()


@pytest.fixture
def browser(chromium, page):
    chromium.resize(1000, 900)
    chromium.scheme("light")
    chromium.open(page)
    return chromium


def content(page) -> dict:
    return json.loads(page.read_text().split('class="data">')[1].split("</script>")[0])


def test_the_page_is_one_file_that_asks_nobody(page):
    text = page.read_text()
    assert "Content-Security-Policy\" content=\"default-src 'none'" in text
    for part in ("src=", "href=", "@import", "url(", "import ", "fetch("):
        assert part not in text
    assert "<h1>A &amp; B</h1>" in text and "<dd>some &lt;nodes&gt;</dd>" in text
    assert content(page)["exhibits"][0]["title"] == HARD and text.count("</script>") == 2
    assert f"{'tri &lt;b&gt;&quot;0&lt;/script&gt;3&quot;'}: blown up cannot be drawn" in text


def test_the_tables_hold_the_figures_of_every_frame(page):
    table = page.read_text().split("<table>")[1].split("</table>")[0]
    head, *rows = [[cell.split(">")[-1] for cell in row.replace("</td>", "</th>").split("</th>")[:-1]] for row in table.split("</tr>")[:-1]]
    assert head[:3] == ["frame", "guess: largest error [mm]", "guess: largest displacement [mm]"]
    assert [row[0] for row in rows] == [f"step {k} of 8" for k in range(9)] and [row[1] for row in rows] == list("012345674")
    # nothing moves: its error is the displacement of the truth
    assert [float(row[head.index("nothing: largest error [mm]")]) for row in rows] == pytest.approx(
        [np.hypot(30 * part, 4 * part**2) for part in np.linspace(0, 1, 9)], rel=1e-3)


def test_the_page_says_how_far_off_each_motion_is_drawn(page):
    text, motions = page.read_text(), content(page)["exhibits"][0]["motions"]
    assert [motion["name"] for motion in motions] == ["guess", "nothing", "fe"] and motions[2]["motion"]["rank"] == 2
    assert f"At most off by: {'; '.join(motion['drawn'] for motion in motions)}." in text
    assert "fe: error 0 mm, displacement 0.000" in text


def test_no_exhibits_make_no_viewer():
    assert section([]) == ""


def test_a_page_has_room_for_any_motion(monkeypatch):
    """Noise has no few shapes: it is cut to the room there is, and the page says how far off it is."""
    monkeypatch.setattr(module, "ROOM", 300_000)
    rng = np.random.default_rng(0)
    motions = {f"noise {i}": Animation(displacement=rng.normal(size=(60, *MESH.points.shape))) for i in range(4)}
    exhibit = Exhibit(title="noise", mesh=MESH, motions=motions, frames=[str(k) for k in range(60)])
    rest = len(section([Exhibit(title="noise", mesh=MESH, motions={name: Animation(displacement=0 * motion.displacement) for name, motion in
                                                              motions.items()}, frames=exhibit.frames)]))
    assert 200_000 < len(section([exhibit])) - rest < 310_000


def silhouette(browser, half: int = 0, halves: int = 2) -> np.ndarray:
    """Where anything is drawn in one of the panels side by side."""
    opaque = browser.pixels("canvas")[..., 3] > 100
    width = opaque.shape[1] // halves
    return opaque[:, half * width:(half + 1) * width]


def edges(mask: np.ndarray) -> np.ndarray:
    """Left, right, top and bottom of what is drawn, from the middle of the panel [pixels]."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    x, y = mask.shape[1] / 2, mask.shape[0] / 2
    return np.array([columns[0] - x, columns[-1] + 1 - x, rows[0] - y, rows[-1] + 1 - y])


def expected(camera: dict, points: np.ndarray, shape: tuple[int, int], turned: float = 0.0, raised: float = 0.0) -> np.ndarray:
    """The same of points in parallel projection, the eye turned about z and raised [rad] from where it starts."""
    x, y, z = camera["eye"]
    around, above = np.arctan2(y, x) + turned, np.arcsin(z) + raised
    right = np.array([-np.sin(around), np.cos(around), 0])
    up = np.array([-np.sin(above) * np.cos(around), -np.sin(above) * np.sin(around), np.cos(above)])
    scale = min(shape[1] / 2 / camera["half"][0], shape[0] / 2 / camera["half"][1])
    across, down = scale * ((points - camera["centre"]) @ right), -scale * ((points - camera["centre"]) @ up)
    return np.array([across.min(), across.max(), down.min(), down.max()])


def middle(browser) -> tuple[float, float]:
    left, top, width, height = browser.box("canvas")
    return left + width / 4, top + height / 2


@browser_needed
def test_it_opens_without_a_complaint_and_without_the_network(browser):
    found = [message for message in browser.said if message["method"] in ("Runtime.exceptionThrown", "Runtime.consoleAPICalled",
                                                                           "Log.entryAdded")]
    assert found == []
    asked = {message["params"]["request"]["url"].partition(":")[0] for message in browser.said
             if message["method"] == "Network.requestWillBeSent"}
    assert asked <= {"file", "data", "blob"} and "file" in asked
    assert browser.run("document.querySelector('.said').textContent") == "step 8 of 8: largest error 4 mm (guess), 0 mm (fe)"
    assert browser.run("document.querySelector('.drawn').textContent").split("; ")[1].startswith("fe: error 0 mm, displacement 0.000")


@browser_needed
def test_both_bodies_stand_where_they_must(browser, page):
    camera = content(page)["exhibits"][0]["camera"]
    for half, path in ((0, wrong()), (1, bent())):
        mask = silhouette(browser, half)
        outline = np.concatenate([MESH.points + path[-1], MESH.points + bent()[-1]])  # the truth's is drawn over the guess
        assert edges(mask) == pytest.approx(expected(camera, outline, mask.shape), abs=2)


@browser_needed
@pytest.mark.parametrize("across, down", [(100, 0), (0, 60), (-150, 40)])
def test_dragging_turns_both_bodies_by_the_same_angle(browser, page, across, down):
    """125 pixels are a radian: to the right turns the near side to the right, down shows more of the top."""
    x, y = middle(browser)
    camera = content(page)["exhibits"][0]["camera"]
    browser.choose(".left select", "fe")
    before = silhouette(browser, 1)
    browser.drag((x, y), (x + across, y + down))
    one, other = silhouette(browser, 0), silhouette(browser, 1)
    assert np.array_equal(one, other) and (other != before).mean() > 0.01
    whole = expected(camera, MESH.points + bent()[-1], other.shape, -0.008 * across, 0.008 * down)
    border = [other.shape[1] / 2] * 2 + [other.shape[0] / 2] * 2
    assert edges(other) == pytest.approx(np.clip(whole, np.negative(border), border), abs=2)


@browser_needed
def test_arrow_keys_turn_plus_zooms_and_zero_shows_all_again(browser, page):
    camera = content(page)["exhibits"][0]["camera"]
    browser.choose(".left select", "fe")
    start = silhouette(browser)
    browser.run("document.querySelector('canvas').focus()")
    for key, turned, raised in (("ArrowLeft", -0.1, 0), ("ArrowUp", -0.1, 0.1), ("ArrowRight", 0, 0.1), ("ArrowDown", 0, 0)):
        browser.press(key)
        mask = silhouette(browser)
        assert edges(mask) == pytest.approx(expected(camera, MESH.points + bent()[-1], mask.shape, turned, raised), abs=2)
    browser.press("-")
    assert edges(silhouette(browser)) == pytest.approx(edges(start) / 1.2, abs=2)
    browser.press("0")
    assert np.array_equal(silhouette(browser), start)
    browser.press("+")
    assert (silhouette(browser) & ~start).any()
    browser.click(".home")
    assert np.array_equal(silhouette(browser), start)


@browser_needed
def test_the_wheel_zooms_and_shift_moves(browser):
    browser.choose(".left select", "fe")
    before = edges(silhouette(browser))
    x, y = middle(browser)
    browser.wheel((x, y), 300)
    assert np.array_equal(edges(silhouette(browser)), before)  # who scrolls past it does not zoom
    x, y = middle(browser)
    browser.drag((x, y), (x, y))
    browser.wheel((x, y), 300)
    smaller = edges(silhouette(browser))
    assert smaller == pytest.approx(before * np.exp(-0.0015 * 300), abs=2)
    browser.drag((x, y), (x + 30, y - 20), modifiers=8)
    assert edges(silhouette(browser)) == pytest.approx(smaller + [30, 30, -20, -20], abs=1)
    assert edges(silhouette(browser, 1)) == pytest.approx(smaller + [30, 30, -20, -20], abs=1)


@browser_needed
def test_scrubbing_moves_the_body_through_time(browser, page):
    camera = content(page)["exhibits"][0]["camera"]
    left, top, width, height = browser.box(".track input")
    for part, step in ((0.5, 4), (0.0, 0), (1.0, 8)):
        x, y = left + 8 + part * (width - 16), top + height / 2
        browser.mouse("mousePressed", x, y, button="left", clickCount=1)
        browser.mouse("mouseReleased", x, y, button="left", clickCount=1)
        browser.settle()
        mask = silhouette(browser, 1)
        assert edges(mask) == pytest.approx(expected(camera, MESH.points + bent()[step], mask.shape), abs=2)
        assert browser.run("document.querySelector('.said').textContent").startswith(f"step {step} of 8")
    browser.run("document.querySelector('.track input').focus()")
    browser.press("ArrowLeft")
    assert browser.run("document.querySelector('.track input').getAttribute('aria-valuetext')") == "step 7 of 8"
    browser.press("Home")
    browser.click(".worst")  # 7 mm in step 7
    assert browser.run("document.querySelector('.said').textContent") == "step 7 of 8: largest error 7 mm (guess), 0 mm (fe)"


@browser_needed
def test_playing_goes_on_until_it_is_stopped(browser):
    frame = "Number(document.querySelector('.track input').value)"
    browser.click(".play")
    browser.until(f"{frame} > 1 && {frame} < 8")
    browser.click(".play")
    here = browser.run(frame)
    assert browser.run(f"new Promise(done => setTimeout(() => done({frame}), 1300))") == here  # two steps would take that


def hue(pixel: np.ndarray) -> np.ndarray:
    """A colour whatever the light: its channels over the largest."""
    return pixel[:3] / pixel[:3].max()


def spread(pixels: np.ndarray, colour: np.ndarray) -> float:
    """Share of what is drawn that has a colour, in any light."""
    drawn = pixels[pixels[..., 3] == 255][:, :3]
    return float((abs(drawn / drawn.max(axis=1, keepdims=True).clip(1) - hue(colour)).max(axis=1) < 0.06).mean())


@browser_needed
def test_colours_are_those_of_the_scale(browser):
    """In step 7 all of the guess is 7 mm off, the largest of all; in step 4 by 4 of these 7. The truth is nowhere off."""
    scale = 255 * np.array([colormaps["YlOrRd"](level)[:3] for level in (0.0, 4 / 7, 1.0)])
    browser.click(".worst")
    half = browser.pixels("canvas").shape[1] // 2
    assert spread(browser.pixels("canvas")[:, :half], scale[2]) > 0.5 and spread(browser.pixels("canvas")[:, half:], scale[0]) > 0.5
    browser.run("document.querySelector('.track input').focus()")
    browser.press("End")
    assert spread(browser.pixels("canvas")[:, :half], scale[1]) > 0.5 and spread(browser.pixels("canvas")[:, :half], scale[2]) < 0.01
    browser.choose(".quantity", "displacement")
    yellow, blue = (255 * np.array(colormaps["viridis"](level)[:3]) for level in (0.99, 0.0))
    right = browser.pixels("canvas")[:, half:]
    ends = [spread(part, colour) for part in (right[:, :half // 4], right[:, -half // 4:]) for colour in (blue, yellow)]
    assert ends[0] > 0.1 and ends[1] == 0 and ends[2] == 0 and ends[3] > 0.02  # dark where it is held, bright where it went farthest
    assert browser.run("document.querySelector('.high').textContent") == "30.5"  # of the guess: 30 mm down, 4 mm back and 4 aside
    browser.choose(".quantity", "von Mises stress")
    assert browser.run("document.querySelector('.unit').textContent") == "von Mises stress [kPa]"
    assert not np.array_equal(browser.pixels("canvas")[:, half:], right)


@browser_needed
def test_the_near_side_hides_the_far_one(chromium, tmp_path):
    """Only the side towards the eye, -y, is off; turned by half a turn, 393 pixels, the body shows its other side."""
    still, off = np.zeros((1, *MESH.points.shape)), np.zeros((1, *MESH.points.shape))
    off[0, MESH.points[:, 1] < 1e-6, 1] = -1e-3
    write_page(tmp_path / "sides.html", "sides", [path_exhibit("sides", MESH, {"guess": off, "fe": still}, RUBBER, truth="fe")], {})
    chromium.resize(1000, 900)
    chromium.open(tmp_path / "sides.html")
    dark, pale = (255 * np.array(colormaps["YlOrRd"](level)[:3]) for level in (1.0, 0.0))
    x, y = middle(chromium)
    for near, far in ((dark, pale), (pale, dark)):
        pixels = chromium.pixels("canvas")
        left = pixels[:, :pixels.shape[1] // 2]
        assert spread(left, near) > 0.4 and spread(left, far) < 0.2  # of the top some is seen as well
        chromium.drag((x - 196, y), (x + 197, y))


@browser_needed
def test_the_csv_holds_the_frame_in_si_units(browser):
    browser.choose(".right select", "nothing")
    rows = list(csv.DictReader(io.StringIO(browser.download(".csv", ".csv").decode())))
    node = np.array([int(row["node"]) for row in rows])
    table = {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}
    places = np.stack([table[f"{axis} at rest [m]"] for axis in "xyz"], axis=1)
    moved = np.stack([table[f"guess: u{axis} [m]"] for axis in "xyz"], axis=1)
    assert places == pytest.approx(MESH.points[node], abs=1e-8) and moved == pytest.approx(wrong()[-1, node], abs=1e-5)
    assert table["guess: error [m]"] == pytest.approx(4e-3, rel=1 / 256)
    assert table["nothing: error [m]"] == pytest.approx(np.linalg.norm(bent()[-1, node], axis=1), abs=1e-4)
    assert table["guess: von Mises stress [kPa]"].max() > 10 and not table["nothing: von Mises stress [kPa]"].any()


@browser_needed
def test_the_picture_taken_home_is_what_is_seen(browser):
    seen = browser.pixels("canvas")
    taken = np.asarray(Image.open(io.BytesIO(browser.download(".png", ".png"))).convert("RGB")).astype(int)
    assert taken.shape[:2] == (seen.shape[0] + 80, seen.shape[1])
    opaque = seen[..., 3] == 255
    assert opaque.mean() > 0.05 and abs(taken[40:-40][opaque] - seen[opaque][:, :3]).max() <= 2
    assert (taken[40:-40][seen[..., 3] == 0] == 255).all() and (taken[:40] < 100).any() and (taken[-40:] < 100).any()


@browser_needed
def test_another_exhibit_is_chosen_by_its_name(browser, page):
    browser.choose(".exhibit", "worst")
    assert browser.run("document.querySelector('.said').textContent") == "step 7 of 8: largest error 7 mm (guess), 0 mm (fe)"
    assert browser.run("document.querySelector('.time').offsetHeight") == 0
    browser.choose(".exhibit", "pressed")
    assert browser.run("document.querySelector('.names').offsetHeight") == 0  # one body alone
    mask, camera = silhouette(browser, 0, 1), content(page)["exhibits"][2]["camera"]
    triangle = np.array([[0.05, 0, 0.05], [0.09, 0, 0.05], [0.07, 0.02, 0.05]])
    assert edges(mask) == pytest.approx(expected(camera, np.concatenate([MESH.points + bent()[-1], triangle]), mask.shape), abs=2)
    pixels = browser.pixels("canvas")
    glass = pixels[(pixels[..., 3] > 100) & (pixels[..., 3] < 200)]  # what lies behind the obstacle is seen through it
    assert np.sum(np.ptp(glass[:, :3], axis=1) < 15) > 3000  # grey; others are pixels that the body covers in part


@browser_needed
def test_dark_and_light_follow_the_reader(browser, tmp_path):
    for scheme, low, high in (("light", 250, 255), ("dark", 10, 40)):
        browser.scheme(scheme)
        browser.settle()
        browser.screen(tmp_path / "screen.png")
        corner = Image.open(tmp_path / "screen.png").convert("RGB").getpixel((3, 3))
        assert all(low <= channel <= high for channel in corner)


@browser_needed
def test_on_a_telephone_the_panels_stand_one_above_the_other_and_nothing_sticks_out(browser, page):
    browser.resize(390, 844)
    browser.settle()
    assert browser.run("document.documentElement.scrollWidth") <= 390
    opaque = browser.pixels("canvas")[..., 3] > 100
    upper, lower = np.split(opaque[:len(opaque) // 2 * 2], 2)
    camera = content(page)["exhibits"][0]["camera"]
    assert edges(lower) == pytest.approx(expected(camera, MESH.points + bent()[-1], lower.shape), abs=2)
    assert edges(upper)[1] - edges(upper)[0] > 250


@browser_needed
def test_every_control_has_a_name_and_the_tables_are_read_out(browser):
    nodes = browser.send("Accessibility.getFullAXTree")["nodes"]
    nodes = [node for node in nodes if not node["ignored"]]
    controls = [(node["role"]["value"], node["name"]["value"]) for node in nodes
                if node["role"]["value"] in ("button", "combobox", "slider", "image")]
    assert len(controls) >= 11 and all(name for _, name in controls)
    assert {("slider", "frame"), ("button", "play"), ("combobox", "colour"), ("button", "worst frame")} <= set(controls)
    browser.click("details summary")
    cells = [node["name"]["value"] for node in browser.send("Accessibility.getFullAXTree")["nodes"]
             if not node["ignored"] and node["role"]["value"] == "cell"]
    assert len(cells) == 9 * 9 and cells[:2] == ["0", "0"]  # three quantities of three motions


@browser_needed
def test_without_webgl_the_words_and_tables_stay(browser, page):
    script = browser.send("Page.addScriptToEvaluateOnNewDocument", source="HTMLCanvasElement.prototype.getContext = () => null")
    try:
        browser.open(page)
        assert "no WebGL 2" in browser.run("document.querySelector('.viewer .alarm').textContent")
        assert browser.run("document.querySelectorAll('table').length") == 3
        assert browser.run("document.querySelector('.controls').offsetHeight") == 0
    finally:
        browser.send("Page.removeScriptToEvaluateOnNewDocument", identifier=script["identifier"])


@browser_needed
def test_modes_swing(chromium, tmp_path):
    mode = np.zeros((2, *MESH.points.shape))
    mode[0, :, 2] = mode[1, :, 1] = (MESH.points[:, 0] / 0.1) ** 2
    exhibit = mode_exhibit(MESH, mode, ["one", "two"])
    write_page(tmp_path / "modes.html", "modes", [exhibit], {})
    chromium.resize(1000, 900)
    chromium.open(tmp_path / "modes.html")
    camera = content(tmp_path / "modes.html")["exhibits"][0]["camera"]
    assert chromium.run("document.querySelector('.said').textContent") == "phase 0 degrees: largest displacement 1 of the largest (one)"
    chromium.run("document.querySelector('.track input').focus()")
    for frame, moved in ((0, mode[0]), (12, -mode[0])):
        for _ in range(frame):
            chromium.press("ArrowRight")
        mask = silhouette(chromium, 0, 1)
        assert edges(mask) == pytest.approx(expected(camera, MESH.points + 0.1 / 6 * moved, mask.shape), abs=2)
