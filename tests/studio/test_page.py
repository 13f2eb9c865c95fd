"""The studio's page in a real browser, driven as a user would.

Skipped without Chromium, Playwright or what the extra `studio` installs; the check of
accessibility also without `npm ci` in `viewer/source`, which brings axe-core.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from latentmotion.motion import Motion
from tests.support.pages import CHROMIUM, walking

pytest.importorskip("fastapi", reason="needs the extra studio")
playwright = pytest.importorskip("playwright.sync_api", reason="needs playwright")
if CHROMIUM is None:
    pytest.skip("needs Chromium (Debian: apt-get install chromium)", allow_module_level=True)

AXE = Path(__file__).parents[2] / "src/latentmotion/viewer/source/node_modules/axe-core/axe.min.js"
SCREENS = ("make", "library", "character", "compare")
PATIENCE = 120_000  # milliseconds; a busy machine is no fault of the page
FLAGS = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
NEWS = """
document.addEventListener("securitypolicyviolation", (event) => {
  console.error(`policy: ${event.violatedDirective} ${event.blockedURI}`);
});
"""
START = """async () => {
  const { studio, player, start } = latentmotion;
  await studio.history.last;
  Object.assign(studio.history, { past: [], future: [] });
  const { draft, takes } = structuredClone(start);
  await studio.replace("Start", draft, takes);
  player.timeline.play(false);
  player.timeline.seek(0);
  for (const panel of ["direct", "edit"]) document.getElementById(panel).open = true;
}"""


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the takes."""
    return tmp_path_factory.mktemp("library")


@pytest.fixture(scope="module")
def address(library: Path) -> Iterator[str]:
    """What `latentmotion studio` prints."""
    program = "from latentmotion.cli.main import main; main()"
    command = [sys.executable, "-c", program, "studio", "--no-browser", "--port", "0"]
    with subprocess.Popen(
        [*command, "--library", library.name],  # relative, as the command's own help has it
        cwd=library.parent,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env=os.environ | {"OMP_NUM_THREADS": "1"},
    ) as server:
        assert server.stdout is not None
        yield server.stdout.readline().strip()
        server.terminate()
        server.stdout.read()


@pytest.fixture(scope="module")
def opened(address: str) -> Iterator[Any]:
    """The page, with four takes of a walk; what it asks of other hosts or is refused is a fault."""
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=list(FLAGS))
        context = browser.new_context(
            viewport={"width": 840, "height": 560}, reduced_motion="reduce", accept_downloads=True
        )
        context.set_default_timeout(PATIENCE)
        page = context.new_page()
        page.add_init_script(NEWS)
        page.faults = []
        host = address.split("/studio")[0]
        page.on("console", lambda said: said.type == "error" and page.faults.append(said.text))
        page.on("pageerror", lambda error: page.faults.append(str(error)))
        page.on(
            "request",
            lambda asked: (
                asked.url.startswith((host, "blob:", "data:")) or page.faults.append(asked.url)
            ),
        )
        page.goto(address)
        page.wait_for_selector("body:is([data-model=warm], [data-state=failed])")
        assert page.get_attribute("body", "data-state") == "ready", page.inner_text("#status")
        page.click("#more-options")
        page.click("#direct summary")
        generated(page, "a person walks forward")
        page.click("#edit summary")
        page.evaluate(
            "latentmotion.start = structuredClone({ draft: latentmotion.studio.draft,"
            " takes: latentmotion.studio.takes })"
        )
        yield page
        browser.close()


@pytest.fixture
def page(opened: Any) -> Iterator[Any]:
    """The page on its first screen with the four takes of the walk, whatever a test left of it."""
    opened.set_viewport_size({"width": 840, "height": 560})
    opened.evaluate("for (const dialog of document.querySelectorAll('dialog')) dialog.close()")
    go(opened, "make")
    opened.evaluate(START)
    opened.select_option("#figure", "stick")  # quick to draw where there is no GPU
    opened.faults.clear()
    yield opened
    assert opened.faults == []


def generated(page: Any, prompt: str, takes: int = 4) -> None:
    page.evaluate("latentmotion.before = latentmotion.studio.takes")
    page.fill("[name=takes]", str(takes))
    page.fill("#prompt", prompt)
    page.press("#prompt", "Enter")
    until(page, "studio.takes !== latentmotion.before && document.body.dataset.state === 'ready'")
    said(page, f"{takes} × ")


def said(page: Any, words: str) -> None:
    page.wait_for_selector(f"#status:has-text('{words}')")


def listed(page: Any, count: str = "true") -> None:
    """Waits until the library shows what its filters let through, as many takes as asked for."""
    page.wait_for_function(
        "() => { const { ariaBusy, dataset: { listed } } = document.getElementById('grid');"
        f" return ariaBusy === 'false' && {count} }}"
    )


def go(page: Any, screen: str) -> None:
    page.click(f"#screens a[href='#{screen}']")
    page.wait_for_selector(f"body[data-screen={screen}]")


def until(page: Any, words: str) -> None:
    """Waits until an expression of the page's own objects is true."""
    page.wait_for_function(f"() => {{ const {{ studio, player }} = latentmotion; return {words} }}")


def asked(page: Any, words: str) -> Any:
    return page.evaluate(f"() => {{ const {{ studio, player }} = latentmotion; return {words} }}")


def downloaded(page: Any, selector: str) -> Path:
    with page.expect_download() as download:
        page.click(selector)
    path = download.value.path()
    return path.rename(path.with_name(download.value.suggested_filename))


def test_work_is_there_again_after_a_reload_and_in_other_tabs(opened, address):
    first = opened.context.new_page()
    first.goto(address)
    first.wait_for_selector("body[data-state=ready][data-model=warm]")
    generated(first, "a person walks forward", takes=2)
    ids = asked(first, "studio.takes.map(({ id }) => id)")
    first.focus("#view canvas")
    first.keyboard.press("2")
    first.keyboard.press("j")
    until(first, "studio.picked === 1 && studio.draft.goals.length === 1")
    first.fill("#prompt", "a person walks for")
    tab = opened.context.new_page()  # without the token in its address
    for page, place in ((tab, address.split("#")[0]), (first, first.url)):
        page.goto(place)
        page.reload()
        page.wait_for_selector("body[data-state=ready][data-model=warm]")
        assert page.input_value("#prompt") == "a person walks for"
        assert asked(page, "studio.takes.map(({ id }) => id)") == ids
        assert asked(page, "[studio.picked, studio.draft.goals.length]") == [1, 1]
        assert page.is_visible("#restored")
    tab.click("#start-anew")
    until(tab, "!studio.takes.length && !studio.draft.goals.length")
    tab.click("#undo")
    until(tab, "studio.takes.length === 2")
    tab.close()
    first.click("#start-anew")
    until(first, "document.body.dataset.takes === '0'")
    assert first.locator("#examples button").count() == 3
    assert first.is_hidden("#transport")
    first.click("#examples button >> nth=1")
    until(first, "studio.takes.length === 4")
    assert asked(first, "studio.take.title") == "a person kicks with the right leg"
    first.close()


def test_the_best_take_is_marked_with_the_reason(page):
    page.wait_for_selector("#why:visible")
    assert re.fullmatch(r"Take \d is the best: [a-z ,]+", page.inner_text("#why"))
    assert page.locator("#picks .best").count() == 1


def test_what_the_model_does_not_know_is_said_while_a_prompt_is_typed(page):
    page.fill("#prompt", "a person defragments a disk")
    page.wait_for_selector("#notice:has-text('defragments')")
    assert page.locator("#nearest button").count() == 1
    page.fill("#prompt", "a person walks forward")
    page.wait_for_selector("#notice", state="hidden")


def test_alone_hides_the_others(page):
    shown = "player.stage.figures.map(({ object }) => object.visible)"
    page.keyboard.press("2")
    page.click("#alone")
    assert asked(page, shown) == [False, True, False, False]
    page.click("#alone")
    assert asked(page, shown) == [True] * 4


def test_the_stage_is_saved_as_a_picture(page):
    content = downloaded(page, "#save-picture").read_bytes()
    assert content.startswith(b"\x89PNG") and len(content) > 5000


def test_a_browser_without_the_cookie_is_told_what_to_do(opened, address):
    context = opened.context.browser.new_context(reduced_motion="reduce")
    page = context.new_page()
    page.goto(address.split("#")[0])
    page.wait_for_selector("body[data-state=failed] #failed:visible")
    assert page.is_hidden("main") and page.is_hidden("#screens")
    page.fill("#sign-in-address", address)
    page.press("#sign-in-address", "Enter")
    page.wait_for_selector("body[data-state=ready]")
    context.close()


def test_one_screen_is_shown_before_any_script_runs(opened, address):
    context = opened.context.browser.new_context(java_script_enabled=False)
    page = context.new_page()
    page.goto(address.split("#")[0])
    parts = page.locator("main > :visible").evaluate_all("all => all.map(({ id }) => id)")
    assert parts[1:] == ["make", "scene", "transport", "strip", "side"]
    context.close()


def test_right_click_on_a_prompt_opens_a_menu(page):
    page.click("#segments button", button="right")
    page.wait_for_selector(".menu")
    rows = page.locator(".menu button").all_inner_texts()
    assert rows == ["Edit", "Usual length", "Duplicate", "Delete"]
    page.click(".menu button:text('Duplicate')")
    until(page, "studio.draft.segments.length === 2")
    page.keyboard.press("Control+z")
    until(page, "studio.draft.segments.length === 1")


def test_a_take_has_one_length_everywhere(page):
    seconds = asked(page, "studio.take.seconds")
    assert seconds == asked(page, "studio.take.frames / studio.take.fps")
    longest = asked(page, "Math.max(...studio.takes.map((take) => take.seconds))")
    assert page.inner_text("#time").endswith(f"/ {longest:.2f} s")
    assert page.inner_text("#facts").startswith(f"{seconds:g} s")


def test_four_takes_move_on_one_clock(page):
    assert page.url.endswith("#make") and "token" not in page.url
    assert asked(page, "player.stage.figures.length") == 4
    before = asked(page, "player.takes.map((take) => [...take.sample(0)])")
    page.keyboard.press("Space")
    until(page, "player.timeline.time > 2")
    page.keyboard.press("Space")
    after = asked(page, "player.takes.map((take) => [...take.sample(player.timeline.time)])")
    moved = np.abs(np.subtract(after, before)).max(axis=1)
    assert (moved > 0.02).all()
    assert len({tuple(take[:9]) for take in after}) == 4


def test_what_the_stage_shows_is_what_the_file_holds(page):
    page.keyboard.press("2")
    until(page, "studio.picked === 1")
    page.check("#mirrored")
    until(page, "studio.take.edits.mirrored && studio.takes.length === 4")
    page.select_option("#format", "npz")
    saved = Motion.load(downloaded(page, "#export"))
    until(page, "player.takes[1].frames === studio.take.frames")
    shown = np.reshape(asked(page, "[...player.takes[1].positions]"), (-1, 22, 3))
    np.testing.assert_allclose(shown, saved.joints, atol=1e-6)
    page.keyboard.press("Control+z")
    until(page, "!studio.take.edits.mirrored")


def test_edits_are_undone_and_done_again_by_keys(page):
    page.click("#view canvas", position={"x": 5, "y": 120})
    page.keyboard.press("1")
    page.keyboard.press("s")
    until(page, "studio.take.star")
    assert page.inner_text("#picks [aria-pressed=true]").startswith("★ 1")
    whole = asked(page, "studio.take.frames")
    page.evaluate("latentmotion.player.timeline.seek(1)")
    page.keyboard.press("i")
    until(page, f"studio.take.frames < {whole}")
    page.keyboard.press("Delete")
    until(page, "studio.takes.length === 3")
    for check in ("studio.takes.length === 4", f"studio.take.frames === {whole}"):
        page.keyboard.press("Control+z")
        until(page, check)
    page.keyboard.press("Control+Shift+z")
    until(page, f"studio.take.frames < {whole}")
    page.keyboard.press("Control+z")
    page.keyboard.press("Control+z")
    until(page, f"!studio.take.star && studio.take.frames === {whole}")
    page.keyboard.press("d")
    until(page, "studio.takes.length === 5 && studio.picked === 1")
    page.keyboard.press("Control+z")
    until(page, "studio.takes.length === 4")


def test_timeline_gets_prompts_and_lengths(page):
    page.keyboard.press("n")
    until(page, "studio.draft.segments.length === 2")
    page.fill("#prompt", "a person jumps")
    page.press("#prompt", "Tab")
    until(page, "studio.draft.segments[1].prompt === 'a person jumps'")
    edge = page.locator(".segment .edge").last
    box = edge.bounding_box()
    page.mouse.move(box["x"] + 4, box["y"] + 10)
    page.mouse.down()
    page.mouse.move(box["x"] - 60, box["y"] + 10)
    page.mouse.up()
    until(page, "studio.draft.segments[1].seconds > 0.5")
    assert page.is_hidden("#direct-body")
    page.fill("[name=seconds]", "2")
    generated(page, "a person jumps", takes=1)
    assert [span["prompt"] for span in asked(page, "studio.take.recipe.timeline")] == [
        "a person walks forward",
        "a person jumps",
    ]
    page.focus("#segments .segment:last-child button")
    page.keyboard.press("Delete")
    until(page, "studio.draft.segments.length === 1")
    page.keyboard.press("Control+z")
    until(page, "studio.draft.segments.length === 2")
    page.click("#segments .segment:last-child .remove")
    until(page, "studio.draft.segments.length === 1")


def floor(page: Any, x: float, z: float) -> list[float]:
    """Returns where a place on the floor is on the screen once the camera has come to rest."""
    return page.evaluate(
        """async (place) => {
          const at = () => latentmotion.directions.hand.onScreen(...place);
          const frame = () => new Promise(requestAnimationFrame);
          for (let before = null, now = at(); ; before = now, now = at()) {
            if (`${before}` === `${now}`) return now;
            await frame().then(frame);
          }
        }""",
        [x, z],
    )


def test_the_interface_for_programs_can_be_tried(page, address):
    other = page.context.new_page()
    other.goto(f"{address.split('/studio')[0]}/docs")
    live = other.locator(".call", has_text="GET /livez")
    live.locator("summary").first.click()
    live.locator("button").click()
    live.locator("pre", has_text="200 text/plain").wait_for()
    other.locator(".call", has_text="POST /v1/motions").locator("summary").first.click()
    assert other.locator("code", has_text="timeline_parts").first.is_visible()
    if AXE.is_file():
        other.evaluate(AXE.read_text("utf-8"))
        assert (
            other.evaluate("axe.run().then((found) => found.violations.map(({ id }) => id))") == []
        )
    other.close()


def test_path_and_goal_are_set_on_the_floor(page):
    page.set_viewport_size({"width": 840, "height": 760})
    page.focus("#view canvas")
    page.keyboard.press("p")
    page.wait_for_selector("#hint:visible")
    page.mouse.click(*floor(page, 0.0, 1.0))
    until(page, "studio.draft.path.length === 2")
    page.mouse.move(*floor(page, 0.0, 1.0))
    page.mouse.down()
    page.mouse.move(*floor(page, 0.3, 1.2), steps=4)
    page.mouse.move(*floor(page, 0.5, 1.5), steps=4)
    page.mouse.up()
    until(page, "studio.draft.path[1].x > 0.45")
    path = asked(page, "studio.draft.path.map(({ x, z }) => [x, z])")
    assert path == [[0, 0], pytest.approx([0.5, 1.5], abs=0.03)]
    page.keyboard.press("k")
    page.select_option("#goal-joint", "right_wrist")
    page.fill("#goal-height", "1.2")
    page.evaluate("latentmotion.player.timeline.seek(1)")
    page.mouse.click(*floor(page, 0.0, 1.0))
    until(page, "studio.draft.goals.length === 1")
    page.keyboard.press("Escape")
    page.wait_for_selector("#hint", state="hidden")
    page.fill("[name=seconds]", "3")
    generated(page, "a person walks forward", takes=1)
    recipe = asked(page, "studio.take.recipe")
    assert recipe["path"]["points"] == path
    (goal,) = recipe["goals"]
    assert (goal["joint"], goal["at"], goal["to"][1]) == ("right_wrist", 1, 1.2)
    assert "right wrist" in page.inner_text("#reached")
    page.click("#goals .remove")
    page.click("#clear-path")
    until(page, "!studio.draft.path.length && !studio.draft.goals.length")


def test_library_finds_tags_and_writes_many(page, tmp_path):
    walking(caption="a foreign walk").save(tmp_path / "foreign.bvh")
    go(page, "library")
    page.set_input_files("#import-file", tmp_path / "foreign.bvh")
    said(page, "Imported foreign.bvh")
    page.fill("#query", "foreign")
    listed(page, "listed === '1'")
    page.wait_for_selector("#grid img")
    page.check("#grid li input[type=checkbox]")
    page.fill("#chosen-tags", "own, walk")
    page.click("#set-tags")
    page.wait_for_selector("#grid li:has-text('own')")
    listed(page)
    page.fill("#query", "")
    listed(page, "listed !== '1'")  # a search that is still awaited would draw the list anew
    page.select_option("#tag", "own")
    listed(page, "listed === '1'")
    page.fill("#grid .title", "mine")
    page.press("#grid .title", "Enter")
    page.wait_for_selector("#grid [aria-label='Title of mine']")
    page.click("#grid .star")
    page.wait_for_selector("#grid .star[aria-pressed=true]")
    page.select_option("#tag", "")
    listed(page, "listed > 4")
    page.check("#only-stars")
    listed(page, "listed === '1'")
    page.uncheck("#only-stars")
    listed(page, "listed > 4")
    cards, stacked = page.locator("#grid > li"), page.locator("#grid .stack").count()
    folded = cards.count()
    page.click("#grid .fold[aria-expanded=false] >> nth=0")
    page.wait_for_selector("#grid .fold[aria-expanded=true]")
    assert cards.count() > folded and page.locator("#grid .stack").count() == stacked - 1
    page.click("#grid .fold[aria-expanded=true]")
    assert cards.count() == folded
    page.click("#choose-all")
    count = int(page.inner_text("#chosen-count").split()[0])
    page.select_option("#zip-format", "bvh")
    with zipfile.ZipFile(downloaded(page, "#export-chosen")) as archive:
        names = archive.namelist()
    assert len(names) == count and all(name.endswith(".bvh") for name in names)
    page.click("#choose-all")
    page.wait_for_selector("#chosen", state="hidden")


def test_deleted_takes_come_back(page):
    go(page, "library")
    listed(page, "listed > 4")
    total = page.inner_text("#total")
    page.check("#grid li:first-child input[type=checkbox]")
    page.click("#delete-chosen")
    said(page, "1 deleted")
    page.check("#only-deleted")
    listed(page)
    page.check("#grid li:first-child input[type=checkbox]")
    page.click("#restore-chosen")
    said(page, "1 restored")
    page.uncheck("#only-deleted")
    page.wait_for_selector(f"#total:text-is('{total}')")


def test_motion_is_shown_on_an_own_character(page, tmp_path):
    walking().save(tmp_path / "hero.glb")
    generated(page, "a person waves", takes=1)
    go(page, "character")
    page.set_input_files("#character-file", tmp_path / "hero.glb")
    said(page, "hero")
    until(page, "player.stage.figures.length === 2")
    assert page.locator("#bones tbody tr").count() == 22
    head = page.locator("#bones tr[data-joint=head] select")
    bone = head.input_value()
    assert bone
    first = asked(page, "player.stage.figures[1].action.time")
    page.evaluate("latentmotion.player.timeline.seek(1)")
    assert asked(page, "player.stage.figures[1].action.time") == 1 != first
    head.select_option("")
    page.wait_for_selector("#bones tr[data-joint=head][data-state=missing]")
    page.keyboard.press("Control+z")
    page.wait_for_selector("#bones tr[data-joint=head]:not([data-state=missing])")
    assert head.input_value() == bone
    page.select_option("#character-format", "bvh")
    assert downloaded(page, "#character-export").read_text().startswith("HIERARCHY")
    go(page, "make")
    page.select_option("#figure", label="hero.glb")
    until(page, "player.stage.figures[0].mixer")
    page.select_option("#figure", "mannequin")
    until(page, "player.stage.figures[0].rig")
    page.select_option("#figure", "stick")
    until(page, "player.stage.figures[0].sticks")


def test_a_file_that_is_no_character_is_refused_in_words(page, tmp_path):
    (tmp_path / "broken.glb").write_bytes(b"glTF is not here")
    go(page, "character")
    page.set_input_files("#character-file", tmp_path / "broken.glb")
    page.wait_for_selector("#status.wrong")
    assert len(page.inner_text("#status")) > 20
    page.faults[:] = [fault for fault in page.faults if "status of 4" not in fault]


def test_two_takes_are_compared_on_one_clock(page):
    page.fill("[name=seconds]", "3")
    generated(page, "a person walks forward", takes=2)
    go(page, "compare")
    starts = "player.takes.map((take, i) => take.ground(0)[0] + player.stage.offsets[i][0])"
    until(page, f"{starts}.length === 2 && {starts}.every((start) => Math.abs(start) < 1e-6)")
    assert page.inner_text("#differences tr.differs th") == "seed"
    page.keyboard.press("g")
    until(page, f"Math.abs({starts}[1] - {starts}[0]) > 0.5")
    page.keyboard.press("g")
    page.fill("#lead-seconds", "1")
    page.press("#lead-seconds", "Enter")
    page.wait_for_selector("body[data-screen=make]")
    until(page, "studio.take.recipe.between && player.takes.length === studio.takes.length")


def test_project_brings_everything_back(page):
    generated(page, "a person kicks", takes=2)
    page.click("#open-projects")
    page.fill("#project-name", "my fight")
    page.press("#project-name", "Enter")
    said(page, "Saved the project my fight")
    ids = asked(page, "studio.takes.map(({ id }) => id)")
    generated(page, "a person sits down", takes=1)
    page.click("#open-projects")
    page.click("[aria-label='Open my fight']")
    said(page, "Opened my fight")
    assert asked(page, "studio.takes.map(({ id }) => id)") == ids
    assert page.input_value("#prompt") == "a person kicks"


def test_a_changed_take_comes_back_with_its_whole_recipe(page):
    generated(page, "a person walks forward", takes=1)
    page.click("#part summary")
    page.fill("#part-prompt", "a person waves the left arm")
    page.select_option("#part-name", "left_arm")
    page.click("#part button")
    until(page, "studio.take.recipe.edit && document.body.dataset.state === 'ready'")
    page.click("#part summary")
    recipe = asked(page, "studio.take.recipe")
    generated(page, "a person stands", takes=1)
    go(page, "library")
    page.fill("#query", "waves the left arm")
    listed(page, "listed === '1'")
    page.click("#grid .picture")
    page.wait_for_selector("body[data-screen=make] #kept:visible")
    assert "changes 0.5 to 1.5 s of a take (left arm)" in page.inner_text("#kept")
    page.click("#kept-none")
    page.wait_for_selector("#kept", state="hidden")
    page.keyboard.press("Control+z")
    page.wait_for_selector("#kept:visible")
    generated(page, "a person waves the left arm", takes=1)
    made = asked(page, "studio.take.recipe")
    assert made == recipe
    page.click("#kept-none")
    page.wait_for_selector("#kept", state="hidden")
    go(page, "library")
    page.fill("#query", "")
    listed(page, "listed > 4")


def test_a_take_is_made_again_to_the_bit(page):
    page.click("#again")
    said(page, "equal to the bit")


def test_a_take_whose_file_is_missing_is_made_again(page, library):
    generated(page, "a person claps", takes=1)
    (library / "motions" / f"{asked(page, 'studio.take.motion')}.npz").unlink()
    go(page, "library")
    page.click("#grid .picture:has-text('File missing')")
    said(page, "is there again")
    page.wait_for_selector("#grid li:first-child img")


def test_an_empty_prompt_is_asked_for(page):
    page.fill("#prompt", "")
    page.press("#prompt", "Enter")
    page.wait_for_selector("#status.wrong:has-text('Write what a person does')")
    assert page.evaluate("document.activeElement.id") == "prompt"
    page.fill("#prompt", "a person stands")
    page.press("#prompt", "Tab")


def test_settings_choose_the_model_of_the_next_takes(page):
    page.click("#open-settings")
    assert page.locator("#model option").all_inner_texts() == ["fast", "starter"]
    page.select_option("#model", "starter")
    said(page, "The model starter makes the next takes.")
    page.keyboard.press("Escape")
    page.select_option("[name=steps]", "10")
    until(page, "studio.draft.settings.steps === 10")
    generated(page, "a person walks", 1)
    assert asked(page, "studio.take.recipe.model") == "starter"
    assert page.inner_text("#facts").endswith("starter")
    page.click("#again")
    said(page, "Made again: equal to the bit.")
    page.keyboard.press("Control+z")
    until(page, "studio.take.recipe.model === 'fast'")
    assert page.inner_text("#facts").endswith("fast")
    page.click("#open-settings")
    page.select_option("#model", "fast")
    until(page, "studio.draft.settings.model === 'fast' && studio.draft.settings.steps === 4")
    assert page.locator("[name=steps] option").all_inner_texts() == ["1", "2", "4"]
    page.keyboard.press("Escape")


def test_a_take_whose_model_is_not_here_says_so(page):
    page.evaluate(
        "() => { const { studio } = latentmotion; studio.take.recipe = { ...studio.take.recipe,"
        " weights: 'f'.repeat(64), model: 'gone' }; studio.tell('pick'); }"
    )
    assert page.inner_text("#facts").endswith("gone, which is not here")


def test_question_mark_shows_the_keys(page):
    page.focus("#view canvas")
    page.keyboard.press("?")
    assert page.locator("#keys kbd").count() > 30
    page.keyboard.press("Escape")
    page.wait_for_selector("#keys", state="hidden")


@pytest.mark.parametrize(("width", "colors"), [(1280, "light"), (390, "dark")])
def test_screens_fit_and_can_be_used_by_all(page, width, colors):
    if not AXE.is_file():
        pytest.skip("needs axe-core: run npm ci in src/latentmotion/viewer/source")
    page.set_viewport_size({"width": width, "height": 844 if width == 390 else 800})
    page.emulate_media(color_scheme=colors, reduced_motion="reduce")
    page.evaluate(AXE.read_text("utf-8"))
    found = {}
    for screen in SCREENS:
        go(page, screen)
        if screen != "library":
            page.wait_for_selector("#view canvas")
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        found[screen] = serious(page)
    for dialog in ("keys", "projects", "settings"):
        page.evaluate("(id) => document.getElementById(id).showModal()", dialog)
        found[dialog] = serious(page)
        page.evaluate("(id) => document.getElementById(id).close()", dialog)
    page.set_viewport_size({"width": 840, "height": 560})
    page.emulate_media(color_scheme="light", reduced_motion="reduce")
    assert not any(found.values()), found


def serious(page: Any) -> list[str]:
    """Returns what is hard to use in what the page shows, as axe finds it."""
    results = page.evaluate("axe.run({ resultTypes: ['violations'] })")
    return [
        f"{one['id']}: {node['html'][:120]}"
        for one in results["violations"]
        if one["impact"] in ("serious", "critical")
        for node in one["nodes"]
    ]


def test_panels_fold_on_a_phone(page):
    page.set_viewport_size({"width": 390, "height": 844})
    page.wait_for_selector("#take:not([open])")
    page.click("#direct summary")
    page.wait_for_selector("#draw-path:visible")
    page.set_viewport_size({"width": 840, "height": 560})
    page.wait_for_selector("#take[open]")


def test_a_phone_shows_one_take(page):
    generated(page, "a person walks forward", takes=2)
    page.set_viewport_size({"width": 390, "height": 844})
    generated(page, "a person walks forward", takes=3)
    shown = "player.stage.figures.map(({ object }) => object.visible)"
    until(page, f"{shown}.join() === 'true,false,false'")
    page.click("#picks button:nth-child(3)")
    until(page, f"{shown}.join() === 'false,false,true'")
    page.set_viewport_size({"width": 840, "height": 560})


def test_page_holds_nothing_inline():
    folder = Path(__file__).parents[2] / "src/latentmotion/studio/assets"
    page = (folder / "index.html").read_text("utf-8")
    assert not re.search(r"<style| style=| on\w+=|https?://", page)
    assert re.findall(r"<script[^>]*>", page) == [
        '<script src="/assets/viewer.js" defer>',  # holds three.js
        '<script src="/studio/assets/studio.js" defer>',
    ]
    style = (folder / "studio.css").read_text("utf-8")
    assert "url(" not in style and "@import" not in style
