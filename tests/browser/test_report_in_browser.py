"""The report of a sweep in a real browser: what a reader sees, presses and hears."""

import io

import numpy as np
import PIL.Image
import pytest
from browser_pages import fetched, until, watched
from sweep_folder import key, make_folder, picture, row

from tfm_cl.sweep import written as sweep_report

NAME = '<img src=x onerror="window.owned=1"><b>smoke</b></script><script>window.owned=1</script>'

DARK, BRIGHT = "b" * 24, "d" * 24


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    """Two volumes: one of hostile name with three series; one of a single basis, much of it missing."""
    first = [
        *(row(n, volume=NAME) for n in (1, 2, 4, 8)),
        *(row(n, volume=NAME, basis="klt", t_error=0.01 / n, key=key(100 + n)) for n in (2, 4)),
        *(
            row(n, volume=NAME, basis="klt", range="trimmed", t_error=0.02 / n, key=key(200 + n))
            for n in (2, 4)
        ),
    ]
    exact = {name: float("inf") for name in ("psnr", "lit_psnr")}
    nothing = {"reference": DARK, "converged": None, "flip": None} | dict.fromkeys(
        f"converged_{part}{name}" for part in ("", "lit_") for name in ("ssim", "psnr", "rmse")
    )
    second = [
        row(2, volume="fog", basis="</b>", key=key(50), **nothing),
        row(4, volume="fog", basis="</b>", rmse=0.0, lit_rmse=0.0, **exact, key=key(51), **nothing),
    ]
    brighter = {key(100 + 2): picture(0.5), key(100 + 4): picture(1.02)}
    out = make_folder(tmp_path_factory.mktemp("report"), first + second, brighter)
    (out / "curves" / f"{DARK}.json").unlink()
    (out / "images" / f"{key(50)}.npy").unlink()
    sweep_report.write(out)
    return out / "report.html"


@pytest.fixture
def show(browser, report):
    """``show(**context)`` opens the report; at the end, nothing was fetched and nothing complained."""
    opened = []

    def show(**context):
        seen = watched(browser, **{"viewport": {"width": 1280, "height": 900}} | context)
        opened.append(seen)
        seen.page.goto(report.as_uri())
        until(seen.page, "document.querySelector('#plot-bytes .main-svg')")
        return seen.page

    yield show
    for seen in opened:
        seen.context.close()
        assert fetched(seen) == [report.as_uri()]
        assert seen.complaints == []


@pytest.fixture
def page(show):
    return show()


def plot(page, name):
    """Name, x and y of each line of a plot, and the title of its vertical axis."""
    return page.evaluate(
        """(id) => {
          const plot = document.getElementById(id);
          const lines = plot.data.map(({name, x, y}) => ({name, x, y}));
          return {lines, title: plot.layout.yaxis.title.text};
        }""",
        f"plot-{name}",
    )


def lines(page, name):
    return {line["name"]: line for line in plot(page, name)["lines"]}


def column(page, name):
    """Texts of a column of the table, from top to bottom."""
    return page.evaluate(
        """(name) => {
          const headings = [...document.querySelectorAll("#table th")];
          const at = headings.findIndex((th) => th.dataset.column === name);
          return [...document.querySelectorAll("#table tbody tr")].map((tr) => tr.cells[at].textContent);
        }""",
        name,
    )


def seen(page):
    """The picture on the stage, as pixels [y, x, 3] of the screen; waits until it is the one asked for."""
    until(page, "document.querySelectorAll('#stage .shown').length === 1")
    page.evaluate(
        "document.querySelectorAll('.badge').forEach((badge) => { badge.style.visibility = 'hidden'; })"
    )
    with PIL.Image.open(io.BytesIO(page.locator("#stage .layers").screenshot())) as image:
        return np.asarray(image.convert("RGB")).astype(int)


def shown(page, layer):
    """Wait until a layer of the stage is the one that shows."""
    until(
        page,
        "(id) => [...document.querySelectorAll('#stage .shown')].map((shown) => shown.id).join() === id",
        f"layer-{layer}",
    )


def select(page, basis, n):
    """Show a map, and wait for its name on the stage."""
    page.locator("#row").select_option(
        label=next(
            text
            for text in page.locator("#row option").all_text_contents()
            if text.startswith(f"{basis} · n = {n}")
        )
    )


def test_a_hostile_name_is_text(page):
    assert page.evaluate("window.owned") is None
    assert page.locator("#volume option").all_text_contents() == [NAME, "fog"]
    assert NAME in page.locator("#table-about").text_content()
    assert page.title() == f"Sweep: {NAME}, fog"
    assert page.locator("b").count() == 0
    page.locator("#volume").select_option(label="fog")
    assert set(lines(page, "bytes")) == {"&lt;/b&gt; ", "selected"}
    point = page.locator("#plot-bytes .points path").first
    point.hover(force=True)
    page.wait_for_selector("#plot-bytes .hovertext")
    assert "</b> · n = 2" in page.locator("#plot-bytes .hovertext").text_content()


@pytest.mark.slow
def test_a_line_for_every_series(page):
    found = lines(page, "bytes")

    assert set(found) == {"dct ", "klt box range", "klt trimmed range", "selected"}
    assert found["dct "]["x"] == [12, 16, 24, 40]
    np.testing.assert_allclose(found["dct "]["y"], [0.05, 0.025, 0.0125, 0.00625])
    np.testing.assert_allclose(found["klt box range"]["y"], [0.005, 0.0025])
    times = lines(page, "seconds")["dct "]
    np.testing.assert_allclose(times["x"], [0.031, 0.032, 0.034, 0.038])


@pytest.mark.slow
def test_the_metric_changes_the_plots(page):
    before = plot(page, "bytes")
    page.locator("#metric").select_option(label="PSNR, lit pixels")
    psnr = plot(page, "bytes")
    page.locator("#metric").select_option(label="1 \u2212 SSIM, lit pixels")
    ssim = plot(page, "seconds")

    assert before["title"].startswith("error of T")
    assert psnr["title"] == "PSNR, lit pixels / dB"
    assert psnr["lines"][0]["y"] == [24, 28, 36, 52]
    np.testing.assert_allclose(ssim["lines"][0]["y"], [0.125, 0.0625, 0.03125, 0.015625])
    assert "lower is better" in page.locator(".bar").text_content()


@pytest.mark.slow
def test_the_dual_march_is_a_marked_point(page):
    assert "dual march" not in lines(page, "seconds")  # its error of T is 0: the mark lies on the axis
    assert "◆" in page.locator("#plot-seconds .annotation").last.text_content()

    page.locator("#metric").select_option(label="RMSE, lit pixels, against converged")

    dual = lines(page, "seconds")["dual march"]
    assert dual["x"] == [0.3]
    assert 0.005 < dual["y"][0] < 0.1


@pytest.mark.slow
def test_exact_maps_are_not_drawn_but_counted(page):
    page.locator("#volume").select_option(label="fog")
    page.locator("#metric").select_option(label="RMSE, lit pixels")

    assert lines(page, "bytes")["&lt;/b&gt; "]["x"] == [16]
    assert "1 of 2 maps are not drawn" in page.locator("#note-bytes").text_content()
    page.locator("#metric").select_option(label="PSNR, lit pixels")
    assert "∞" in column(page, "lit_psnr")
    assert column(page, "flip") == ["–", "–"]
    assert "∞" in page.locator("#budgets").text_content()


@pytest.mark.slow
def test_the_volume_changes_everything(page):
    page.locator("#volume").select_option(label="fog")

    assert len(column(page, "basis")) == 2
    assert page.locator("#row option").count() == 2
    assert set(lines(page, "seconds")) == {"&lt;/b&gt; ", "selected"}
    assert "no readable curves" in page.locator("#curves-about").text_content()
    assert not page.locator("#curves-body").is_visible()


@pytest.mark.slow
def test_the_legend_switches_lines(page):
    page.locator("#series button", has_text="trimmed range").click()
    assert set(lines(page, "bytes")) == {"dct ", "klt box range", "selected"}
    assert set(lines(page, "seconds")) == {"dct ", "klt box range", "selected"}
    page.locator("#series button", has_text="klt").first.press("Enter")
    assert set(lines(page, "bytes")) == {"dct ", "selected"}
    assert page.evaluate("document.activeElement.textContent") == "klt"
    page.keyboard.press("Enter")
    assert set(lines(page, "bytes")) == {"dct ", "klt box range", "klt trimmed range", "selected"}


@pytest.mark.slow
def test_the_table_sorts(page):
    heading = page.locator("#table th[data-column=t_error]")
    heading.locator("button").click()
    up = [float(text) for text in column(page, "t_error")]
    assert heading.get_attribute("aria-sort") == "ascending"
    page.keyboard.press("Enter")
    down = [float(text) for text in column(page, "t_error")]

    assert up == sorted(up)
    assert up != down == sorted(down, reverse=True)
    assert heading.get_attribute("aria-sort") == "descending"
    page.locator("#table th[data-column=range] button").click()
    assert column(page, "range") == ["box"] * 6 + ["trimmed"] * 2


@pytest.mark.slow
def test_the_table_marks_the_best_at_equal_bytes(page):
    marks = dict(
        zip(
            zip(column(page, "basis"), column(page, "coeffs"), strict=True),
            column(page, "budgets"),
            strict=True,
        )
    )

    assert marks["dct", "2"] == "★ 16 B"
    assert marks["dct", "4"] == "★ 24 B"
    assert marks["dct", "8"] == "★ 40 B"
    assert marks["dct", "1"] == ""


@pytest.mark.slow
def test_every_column_can_be_had(page):
    few = page.locator("#table th").count()
    page.locator("#every").check()

    assert page.locator("#table th").count() > few
    assert len(column(page, "converged_ssim")) == 8


@pytest.mark.slow
def test_the_viewer_flips(page):
    select(page, "klt", 2)
    shown(page, "image")
    image = seen(page)
    stage = page.locator("#stage")
    stage.click()
    shown(page, "reference")
    reference = seen(page)
    stage.click()
    shown(page, "image")

    assert image.shape == reference.shape
    # Half the light is 188/255 of the display value; compare where it is not clipped.
    assert 1.25 < reference.sum() / image.sum() < 1.45
    np.testing.assert_array_equal(seen(page), image)
    source = page.locator("#layer-image").get_attribute("src")
    assert source.startswith("data:image/png;base64,")
    assert source != page.locator("#layer-reference").get_attribute("src")


@pytest.mark.slow
def test_the_viewer_wipes(page):
    select(page, "klt", 2)
    shown(page, "image")
    image = seen(page)
    page.locator("[data-side=reference]").click()
    shown(page, "reference")
    reference = seen(page)
    page.locator("[data-side=image]").click()
    page.locator("#wipe").click()
    shown(page, "image")
    divider = page.get_by_role("slider")
    width = image.shape[1]

    def parts(at):
        """Whether both pictures are where they belong, beside the divider at a part of the width."""
        both, middle = seen(page), round(at * width)
        left, right = slice(0, middle - 16), slice(middle + 16, width)
        np.testing.assert_array_equal(both[:, left], image[:, left])
        np.testing.assert_array_equal(both[:, right], reference[:, right])

    parts(0.5)
    assert divider.get_attribute("aria-valuenow") == "50"
    badges = page.locator(".badge").all_text_contents()
    assert badges == ["klt · n = 2 · box range", "dual march, same steps"]
    box = page.locator("#stage .layers").bounding_box()
    middle = box["y"] + box["height"] / 2
    page.mouse.move(box["x"] + box["width"] / 2 + 5, middle)  # a little beside it: it must not jump
    page.mouse.down()
    page.mouse.move(box["x"] + box["width"] * 0.25 + 5, middle, steps=4)
    page.mouse.up()
    assert divider.get_attribute("aria-valuenow") == "25"
    parts(0.25)
    for pressed, at in (("ArrowRight", 26), ("Shift+ArrowRight", 36), ("PageDown", 26), ("End", 100)):
        divider.press(pressed)
        assert divider.get_attribute("aria-valuenow") == str(at)
    page.mouse.click(box["x"] + box["width"] * 0.75, middle)
    parts(0.75)
    page.locator("#stage").press("w")
    assert not divider.is_visible()
    np.testing.assert_array_equal(seen(page), image)


@pytest.mark.slow
def test_the_viewer_listens_to_keys(page):
    page.locator("#stage").focus()
    for pressed, layer in (
        ("2", "reference"),
        ("3", "error"),
        ("1", "image"),
        ("Space", "reference"),
        ("Space", "image"),
    ):
        page.keyboard.press(pressed)
        shown(page, layer)
    first = page.locator("#row").input_value()
    page.keyboard.press("n")
    second = page.locator("#row").input_value()
    page.keyboard.press("p")

    assert first != second
    assert page.locator("#row").input_value() == first
    page.locator("#table tbody button").first.press("2")  # elsewhere, keys are the browser's own
    shown(page, "image")


@pytest.mark.slow
def test_errors_have_the_colour_of_their_sign(page):
    page.locator("#sign").select_option("signed")
    page.locator("[data-side=error]").click()
    select(page, "klt", 2)
    until(page, "document.querySelector('.badge').textContent.includes('n = 2')")
    shown(page, "error")
    dark = seen(page)
    select(page, "klt", 4)
    until(page, "document.querySelector('.badge').textContent.includes('n = 4')")
    page.locator("#gain").select_option("50")
    until(page, "document.querySelector('.badge').textContent.includes('×50')")
    bright = seen(page)
    middle = tuple(side // 2 for side in dark.shape[:2])

    assert dark[middle][2] > dark[middle][0] + 40  # blue: too dark
    assert bright[middle][0] > bright[middle][2] + 40  # orange: too bright
    assert dark[1, 1].max() == 0  # black: right
    page.locator("#sign").select_option("magnitude")
    until(page, "document.getElementById('scale-low').textContent === '0'")


@pytest.mark.slow
def test_errors_can_be_against_the_converged_one(page):
    select(page, "dct", 8)
    page.locator("[data-side=error]").click()
    page.locator("#gain").select_option("50")
    until(page, "document.querySelector('.badge').textContent.includes('×50')")
    shown(page, "error")
    against_dual = page.evaluate("viewer.errors.values.reduce((sum, value) => sum + value, 0)")
    page.locator("#against").select_option(label="dual, converged")
    until(
        page,
        "(before) => viewer.errors && viewer.errors.values.reduce((s, v) => s + v, 0) !== before",
        against_dual,
    )
    against_converged = page.evaluate("viewer.errors.values.reduce((sum, value) => sum + value, 0)")

    # The converged one is darker than the dual march, and this map darker than both.
    assert against_dual < against_converged < 0
    page.locator("[data-side=reference]").click()
    shown(page, "reference")
    assert "converged" in page.locator("#layer-reference").get_attribute("alt")


@pytest.mark.slow
def test_zoom_keeps_pixels_square_and_sharp(page):
    natural = page.evaluate("document.getElementById('layer-image').naturalWidth")
    page.locator("#zoom").select_option("4")
    until(page, "(width) => document.querySelector('#stage .layers').clientWidth === width", 4 * natural)
    line = seen(page)[10 * 4]
    natural_line = line[1 + np.flatnonzero(np.abs(np.diff(line, axis=0)).sum(axis=1))]

    # Where anything was interpolated, nearly every pixel of the screen would differ from the one before.
    assert natural // 3 < len(natural_line) < natural


@pytest.mark.slow
def test_a_row_without_a_picture_says_so(page):
    page.locator("#volume").select_option(label="fog")
    select(page, "</b>", 2)
    page.wait_for_selector(".stage-notice:visible")

    assert page.locator(".stage-notice").text_content() == "The image is not in the sweep's folder."
    assert "Not in the sweep's folder: </b> · n = 2." in page.locator("#note-pictures").text_content()
    page.locator("[data-side=reference]").click()
    shown(page, "reference")


@pytest.mark.slow
def test_a_choice_shows_everywhere(page):
    page.locator("#budgets button", has_text="dct").last.click()
    assert page.locator("#row option:checked").text_content().startswith("dct · n = 8")
    ring = lines(page, "bytes")["selected"]
    np.testing.assert_allclose((ring["x"][0], ring["y"][0]), (40, 0.00625))
    assert page.locator("#table tr.selected").count() == 1
    assert page.locator("#sheet button[aria-pressed=true]").get_attribute("title") == "dct · n = 8"
    page.locator("#sheet button").nth(1).click()
    assert page.locator("#row").input_value() == "1"
    page.locator("#table tbody button").nth(2).click()
    assert page.locator("#row").input_value() == "2"


@pytest.mark.slow
def test_a_point_of_the_plot_can_be_clicked(page):
    path = page.locator("#plot-bytes .scatterlayer .trace").first.locator(".points path").first
    path.scroll_into_view_if_needed()
    box = path.bounding_box()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.wait_for_selector("#plot-bytes .hovertext")
    page.mouse.down()
    page.mouse.up()

    until(page, "document.getElementById('row').selectedOptions[0].textContent.startsWith('dct · n = 1 ')")


def test_all_pictures_are_on_the_sheet(page):
    page.locator("#sheet").scroll_into_view_if_needed()
    assert page.locator("#sheet button").count() == 8
    until(page, "[...document.querySelectorAll('#sheet canvas')].every((canvas) => canvas.width > 10)")
    page.locator("#sheet-side").select_option("image")
    until(
        page,
        "[...document.querySelectorAll('#sheet img')].filter((image) => image.naturalWidth > 9).length === 8",
    )


@pytest.mark.slow
def test_curves_can_be_switched(page):
    def names():
        return [line["name"] for line in plot(page, "curves")["lines"]]

    # Of each basis, the best at the middle budget; T above, and its error below.
    assert names() == ["exact", *(["dct · n = 4"] * 2), *(["klt · n = 4 · box range"] * 2)]
    error = plot(page, "curves")["lines"][2]["y"]
    np.testing.assert_allclose(error, 0.1 / 4, rtol=1e-9)
    button = page.locator("#curves-keys button[aria-label='dct · n = 1']")
    button.click()
    assert names().count("dct · n = 1") == 2
    assert button.get_attribute("aria-pressed") == "true"
    page.keyboard.press("Space")
    assert "dct · n = 1" not in names()
    page.locator("#curves-all").click()
    assert len(names()) == 1 + 2 * 8
    page.locator("#curves-none").click()
    assert names() == ["exact"]


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_colours_follow_the_reader(show, scheme):
    page = show(color_scheme=scheme)

    def brightness():
        return page.evaluate(
            "getComputedStyle(document.body).backgroundColor.match(/[0-9.]+/g).map(Number)[0]"
        )

    def ink():
        return page.evaluate("document.getElementById('plot-bytes').layout.font.color")

    first, line = brightness(), ink()
    assert (first > 128) == (scheme == "light")
    page.locator("#theme").click()
    assert (brightness() > 128) != (scheme == "light")
    assert ink() != line


@pytest.mark.slow
@pytest.mark.parametrize("width", [360, 768, 1280])
def test_nothing_sticks_out(show, width):
    page = show(viewport={"width": width, "height": 800}, has_touch=width < 500, is_mobile=width < 500)
    for volume in ("fog", NAME):
        page.locator("#volume").select_option(label=volume)
        assert page.evaluate("document.documentElement.scrollWidth") <= width


@pytest.mark.slow
def test_everything_has_a_name(page):
    """What a screen reader says of each control and picture."""
    page.locator("#sheet").scroll_into_view_if_needed()
    until(page, "[...document.querySelectorAll('#sheet canvas')].every((canvas) => canvas.width > 10)")
    nameless = page.evaluate(
        """() => {
          const wanted = "main :is(button, select, input, img, [role]), header button, .bar select";
          const named = (element) => element.ariaLabel || element.alt || element.labels?.length
            || element.getAttribute("aria-labelledby")
            || (element.matches("button") && element.textContent.trim());
          return [...document.querySelectorAll(wanted)]
            .filter((element) => element.checkVisibility({visibilityProperty: true}))
            .filter((element) => element.matches(".plot") || !element.closest(".plot"))
            .filter((element) => !named(element))
            .map((element) => element.outerHTML.slice(0, 120));
        }"""
    )

    assert nameless == []


@pytest.mark.slow
def test_the_keyboard_reaches_everything(page):
    reached = set()
    for _ in range(400):
        page.keyboard.press("Tab")
        name = page.evaluate("document.activeElement.id || document.activeElement.parentElement.id || ''")
        where = page.evaluate(
            "document.activeElement.closest('#budgets, #series, #sheet, #curves-keys, #table')?.id"
        )
        reached |= {name, where}
        if where == "table":
            break

    assert {
        *(
            "theme",
            "volume",
            "metric",
            "budgets",
            "row",
            "against",
            "gain",
            "sign",
            "zoom",
            "stage",
            "sheet-side",
        ),
        *("sheet", "series", "curves-keys", "curves-all", "every", "table"),
    } <= reached
