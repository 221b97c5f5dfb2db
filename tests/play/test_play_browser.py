"""A real browser plays: what is clicked is what is recorded.

Chromium, without a display. Where there is none these tests are skipped, except where
``OPENLOCK_BROWSER=required`` says that there must be one, as ``.ci/run`` does.
"""

import os
import re
import signal
from itertools import permutations

import numpy as np
import pytest
from playwright.sync_api import expect, sync_playwright

from causal_openlock.experiment.beside_record import read_answers, read_reactions
from causal_openlock.storage.store import Store
from support import browsers
from support.accessibility import violations
from support.play_clients import asked, serving
from support.waiting import HANGS

pytestmark = pytest.mark.browser
expect.set_options(timeout=60_000)  # a slow machine is no fault of the page

REQUIRED = os.environ.get("OPENLOCK_BROWSER") == "required"
if not REQUIRED and not browsers.installed():
    pytest.skip(browsers.MISSING, allow_module_level=True)

DOOR = 14
CC3 = ("--condition", "CC3", "--no-practice")
READY = "#room:not(.busy)"


@pytest.fixture(scope="module")
def browser():
    with sync_playwright() as playwright:
        launched = browsers.launch(playwright)
        yield launched
        launched.close()


@pytest.fixture
def page(browser):
    """A page at which nothing may go wrong, and which asks nobody but its own server."""
    context = browser.new_context(reduced_motion="reduce", viewport={"width": 1200, "height": 850})
    opened = context.new_page()
    faults, asked = [], set()

    def heard(message):
        # A server that is away or says no is told of here too, and is meant to be.
        if message.type == "error" and "Failed to load resource" not in message.text:
            faults.append(message.text)

    opened.on("console", heard)
    opened.on("pageerror", lambda error: faults.append(str(error)))
    opened.on("request", lambda request: asked.add(request.url.split("/")[2].split(":")[0]))
    yield opened
    context.close()
    assert not faults
    assert asked == {"127.0.0.1"}


def click(page, action):
    """Click a part of the room with the mouse, and wait until the arm has come to rest."""
    page.click(f'{READY} [data-action="{action}"]')
    page.wait_for_selector(f"{READY}, #pause:not([hidden])", state="attached")


def begin(page, url):
    page.goto(url)
    page.click("#begin")
    page.click("#pause-go")


def grey(page):
    """The positions of the grey levers, as somebody sees them who cannot see."""
    labels = [
        page.get_attribute(f'[data-action="{place}"]', "aria-label") or "" for place in range(7)
    ]
    return [place for place, label in enumerate(labels) if "grey" in label]


def left(page):
    """Combinations, attempts and actions left, as the console says."""
    return tuple(int(page.inner_text(f"#{name}")) for name in ("solutions", "attempts", "actions"))


def test_a_whole_trial_is_played_by_clicking_and_recorded_as_clicked(page, tmp_path):
    page.emulate_media(
        reduced_motion="no-preference"
    )  # the first attempt with the arm really moving
    with serving(tmp_path, *CC3) as server:
        begin(page, server.url)
        assert left(page) == (2, 30, 3)
        clicked = []
        found = []
        for first, second in permutations(grey(page), 2):
            solutions, attempts, _ = left(page)
            assert attempts == 30 - len(clicked)
            clicked.append([first, second, DOOR])
            for action in clicked[-1]:
                click(page, action)
            page.emulate_media(reduced_motion="reduce")
            if page.is_visible("#pause"):
                found.append(len(clicked))
                break
            page.wait_for_function("document.querySelector('#actions').textContent === '3'")
            if left(page)[0] < solutions:
                found.append(len(clicked))
        assert len(found) == 2
        expect(page.locator("#pause-title")).to_have_text("You found every combination!")
        page.click("#pause-go")
        expect(page.locator("#pause-title")).to_have_text("Room 2 of 5")
        server.stop()
    record = Store(tmp_path).record()[0].to_pandas()
    assert record["actions"].map(list).tolist() == clicked
    assert record.loc[record["new_solution"], "attempt"].tolist() == found
    assert record["solutions_found"].max() == 2
    assert record["learner"].unique().tolist() == ["person"]
    reactions = read_reactions(tmp_path).to_pandas()
    assert reactions["action"].tolist() == [action for attempt in clicked for action in attempt]
    assert reactions["reaction"].between(0.0, 5.0).all()


def test_each_room_has_as_many_actions_as_it_shows(page, tmp_path):
    words = ["--condition", "chain3", "--condition", "CC3", "--no-practice", "--recruiting", "PID"]
    limits = set()
    with serving(tmp_path, *words) as server:
        for name in ("ann", "ben"):  # one plays each condition
            page.goto(f"{server.url}?PID={name}")
            expect(page.locator("#intro")).to_contain_text("You have 3 or 4 actions in each")
            page.click("#begin")
            page.click("#pause-go")
            limits.add(left(page)[-1])
            assert page.locator("#dots i").count() == left(page)[-1]
    assert limits == {3, 4}


def test_pulling_pushing_and_the_door_are_where_the_paper_has_them(page, tmp_path):
    with serving(tmp_path, *CC3) as server:
        begin(page, server.url)
        room = page.locator("#room").bounding_box()
        view = [float(x) for x in (page.get_attribute("#room", "viewBox") or "").split()]
        assert room is not None
        scale = min(room["width"] / view[2], room["height"] / view[3])
        x0 = room["x"] + (room["width"] - scale * view[2]) / 2
        y0 = room["y"] + (room["height"] - scale * view[3]) / 2

        def at(x, y):
            page.wait_for_selector(READY)
            page.mouse.click(x0 + scale * (x - view[0]), y0 + scale * (-y - view[1]))

        # The upper lever's outer track, its inner track, the green button: Figure 2a's places.
        for point in ((0.0, 3.45), (0.0, 2.95), (4.2, 1.6)):
            at(*point)
            page.wait_for_timeout(50)
        page.wait_for_selector(READY)
        # Beside them nothing happens.
        at(-0.8, 3.0)
        at(0.0, 0.0)
        assert left(page) == (2, 29, 3)
        server.stop()
    assert read_reactions(tmp_path)["action"].to_pylist() == [1, 8, 14]


def test_the_keyboard_is_enough(page, tmp_path):
    with serving(tmp_path, "--condition", "CC3") as server:
        page.goto(server.url)
        page.wait_for_selector("#begin")  # until then it is hidden and takes no focus
        page.locator("#begin").focus()
        page.keyboard.press("Enter")
        page.wait_for_selector(READY)
        for key, actions in (("3", "2"), ("Shift+Digit3", "1"), ("1", "0")):
            page.wait_for_selector(READY)
            page.keyboard.press(key)
            expect(page.locator("#actions")).to_have_text(actions)
        expect(page.locator("#said")).to_contain_text("Nothing moved.")
        expect(page.locator("#attempts")).to_have_text("29")
        page.wait_for_selector(READY)
        # From one target to the next, with a focus that can be seen, each with a name.
        names = []
        page.locator("#help").focus()
        for _ in range(15):
            page.keyboard.press("Tab")
            names.append(page.evaluate("document.activeElement.getAttribute('aria-label')"))
            marked = "getComputedStyle(document.activeElement.querySelector('.hit')).strokeWidth"
            assert page.evaluate(marked) != "0px"
        assert names[4] == "Push lever 3, upper left, grey, pulled"
        assert names[5] == "Pull lever 3, upper left, grey, pulled"
        assert names[14] == "Push the door, locked"
        page.locator('[data-action="2"]').focus()
        page.keyboard.press("Enter")
        expect(page.locator("#said")).to_have_text("The door is unlocked.")
        page.wait_for_selector(READY)
        page.keyboard.press("D")  # as with Caps Lock
        expect(page.locator("#said")).to_have_text("That is all there is to practice.")
        expect(page.locator("#solutions")).to_have_text("–")  # none of it is still to be found
        page.keyboard.press("Enter")  # the way on has the focus
        expect(page.locator("#pause-title")).to_have_text("Room 1 of 5")
        page.keyboard.press("Enter")
        page.wait_for_selector(READY)
        assert left(page) == (2, 30, 3)
        page.uncheck("#keys")
        page.keyboard.press("1")
        assert left(page) == (2, 30, 3)


KEYBOARDS = [
    ({"key": "в", "code": "KeyD"}, DOOR),  # Cyrillic
    ({"key": "Process", "code": "KeyD"}, DOOR),  # an input method
    ({"key": "d", "code": "KeyH"}, DOOR),  # Dvorak
    ({"key": "&", "code": "Digit1"}, 0),  # French
    ({"key": "3", "code": "Numpad3"}, 2),
    ({"key": "PageDown", "code": "Numpad3", "modifierNumLock": True}, 9),  # Shift, on Windows
    ({"key": "PageDown", "code": "Numpad3", "shiftKey": True}, 9),
]


def test_keys_are_those_of_their_places_on_any_keyboard(page, tmp_path):
    with serving(tmp_path, *CC3) as server:
        begin(page, server.url)
        for event, _ in KEYBOARDS:
            page.wait_for_selector(READY)
            pressed = "event => document.dispatchEvent(new KeyboardEvent('keydown', event))"
            page.evaluate(pressed, event)
        page.wait_for_selector(READY)
        server.stop()
    assert read_reactions(tmp_path)["action"].to_pylist() == [action for _, action in KEYBOARDS]


SIDES = """
() => [...document.querySelectorAll("#room .hit")].flatMap((node) => {
  const box = node.getBBox(), { a, b } = node.getScreenCTM(), scale = Math.hypot(a, b);
  return [scale * box.width, scale * box.height];
})
"""


@pytest.mark.parametrize("levers", [7, 12])
def test_a_finger_hits_each_lever_on_the_smallest_screen(page, tmp_path, levers):
    names = [f"L{number}" for number in range(levers)]
    edges = ", ".join(f"{name}: [door]" for name in names)
    schema = f"name: many\nlevers: [{', '.join(names)}]\nedges: {{{edges}}}\n"
    (tmp_path / "many.yaml").write_text(schema)
    page.set_viewport_size({"width": 320, "height": 640})
    for first in ("--practice", "--no-practice"):  # the practice room has seven levers
        words = ["--condition", str(tmp_path / "many.yaml"), first]
        with serving(tmp_path / first, *words) as server:
            page.goto(server.url)
            page.click("#begin")
            if first == "--no-practice":
                page.click("#pause-go")
            page.wait_for_selector(READY)
            assert min(page.evaluate(SIDES)) >= 24


def test_a_tab_continues_what_another_one_has_begun(page, tmp_path):
    with serving(tmp_path, *CC3, "--recruiting", "PID") as server:
        url = f"{server.url}?PID=ann#_=_"  # as some sites add to addresses
        second = page.context.new_page()
        second.goto(url)
        second.wait_for_selector("#begin")
        begin(page, url)
        click(page, 3)
        second.click("#begin")
        second.wait_for_selector(READY)
        assert left(second) == left(page) == (2, 30, 2)
        assert second.url == page.url
        assert re.search(r"/\?PID=ann#[\w-]{32}$", page.url)
        server.stop()
    assert (tmp_path / "recruited.csv").read_text() == "join,PID\n0,ann\n"


def test_a_closed_tab_and_a_second_one_go_on_where_the_person_is(page, tmp_path):
    with serving(tmp_path, *CC3) as server:
        begin(page, server.url)
        first = grey(page)[0]
        click(page, first)
        assert re.fullmatch(r"http://127\.0\.0\.1:\d+/#[\w-]{32}", page.url)
        label = page.get_attribute(f'[data-action="{first}"]', "aria-label")
        second = page.context.new_page()
        second.goto(server.url)  # the browser remembers; the address is not needed
        second.wait_for_selector(READY)
        assert left(second) == left(page) == (2, 30, 2)
        assert second.get_attribute(f'[data-action="{first}"]', "aria-label") == label
        click(second, DOOR)
        page.click('[data-action="3"]')  # out of turn: the other tab has gone on
        expect(page.locator("#said")).to_contain_text("went on elsewhere")
        assert left(page) == left(second) == (2, 30, 1)
        second.close()
        page.goto(f"{server.url}#{'A' * 32}")
        expect(page.locator("#trouble-title")).to_have_text("This session is not known here")
        page.click("#trouble-go")  # the session of this browser is not lost by a wrong address
        page.wait_for_selector(READY)
        assert left(page) == (2, 30, 1)
        server.stop()
    assert read_reactions(tmp_path)["action"].to_pylist() == [first, DOOR]


def test_a_click_at_a_server_that_is_away_counts_once_when_it_is_back(page, tmp_path):
    with serving(tmp_path, *CC3) as server:
        begin(page, server.url)
        click(page, 5)
        server.kill()
        page.click('[data-action="6"]')
        page.wait_for_selector("#offline:not([hidden])")
    with serving(tmp_path, *CC3, port=server.port) as again:
        page.wait_for_selector("#offline", state="hidden")
        page.wait_for_selector(READY)
        assert left(page) == (2, 30, 1)
        click(page, 4)
        again.stop()
    assert read_reactions(tmp_path)["action"].to_pylist() == [5, 6, 4]


ONE_LEVER = "name: one\nlevers: [L0]\nedges: {L0: [door]}\n"


def test_who_has_finished_never_reads_of_a_lost_connection(page, tmp_path):
    """The server is stopped as soon as the last action is answered: all that is left is there."""
    (tmp_path / "one.yaml").write_text(ONE_LEVER)
    words = ["--condition", str(tmp_path / "one.yaml"), "--no-practice"]
    words += ["--completion", "http://127.0.0.1:1/done"]
    with serving(tmp_path / "out", *words) as server:
        begin(page, server.url)
        for room in range(1, 6):
            click(page, grey(page)[0])
            click(page, DOOR)
            expect(page.locator("#pause-title")).to_have_text("You found every combination!")
            if room < 5:
                page.click("#pause-go")
                page.click("#pause-go")
                page.wait_for_selector(READY)
        server.process.send_signal(signal.SIGINT)
        said, _ = server.process.communicate(timeout=HANGS)
    page.click("#pause-go")
    expect(page.locator("#outcome")).to_have_text("You found every combination in every room.")
    assert page.get_attribute("#back-link", "href") == "http://127.0.0.1:1/done"
    assert page.is_visible("#end")
    assert page.is_hidden("#offline")
    lines = [line for line in said.splitlines() if "joined" in line]
    assert lines[0] == "joined: 1, finished: 0"
    assert lines[-1].startswith("joined: 1, finished: 1; ")


def test_the_instructions_name_the_colours_and_not_what_they_mean(page, tmp_path):
    """The paper's participants saw grey and white levers, and were not told which are active."""
    with serving(tmp_path, *CC3) as server:
        page.goto(server.url)
        page.wait_for_selector("#begin")
        told = page.inner_text("#intro")
    (sentence,) = [line for line in told.splitlines() if "grey" in line]
    plain = " ".join(sentence.split()).replace(" .", ".")  # swatches stand between the words
    assert "Some levers are grey and others white." in plain
    assert not re.search("active|belong|mechanism|move|never", sentence)


def test_axe_finds_nothing_on_any_screen(page, tmp_path):
    """Nor type of too little contrast, whatever theme the browser prefers."""
    page.emulate_media(color_scheme="dark")
    with serving(tmp_path, "--condition", "CC3") as server:
        page.goto(server.url)
        page.wait_for_selector("#begin")
        for go_on in ("#begin", "#proceed", "#pause-go", None):
            assert violations(page) == []
            if go_on:
                page.click(go_on)
                page.wait_for_selector(f"{READY}, #pause-go")


def test_a_room_that_is_shown_is_a_film_that_goes_on_after_a_reload(page, tmp_path):
    with serving(tmp_path, "--condition", "shown-CC3-CC4", "--no-practice") as server:
        page.goto(server.url)
        page.click("#begin")
        expect(page.locator("#pause-text")).to_contain_text("Here you only watch: the arm shows")
        page.click("#pause-go")
        expect(page.locator("#solutions")).to_have_text("1", timeout=HANGS * 1000)
        page.reload()
        title = page.locator("#pause-title")
        expect(title).to_have_text("You have seen every combination", timeout=HANGS * 1000)
        page.click("#pause-go")
        expect(title).to_have_text("Room 2 of 7")
        assert violations(page) == []
        # The other rooms go by without the page, and in the last one everything is tried.
        me, turn = page.url.partition("#")[2], 6
        while (room := asked(server.url, "state", id=me)["room"]).get("shown") is not None:
            asked(server.url, "turn", id=me, turn=turn, action=room["shown"], reaction=None)
            turn += 1
        for pair in permutations(np.flatnonzero(room["observation"][7:14]).tolist(), 2):
            for action in (*pair, DOOR):
                said = asked(server.url, "turn", id=me, turn=turn, action=action, reaction=9)
                turn += 1
            if said["trial_over"]:
                break
        page.reload()
        expect(page.locator("#outcome")).to_have_text("You found every combination in every room.")
        assert page.locator("#rooms").inner_text().count("shown to you") == 6
        server.stop()
    record = Store(tmp_path).record()[0].to_pandas()
    assert record["phase"].tolist()[:12] == ["shown"] * 6 * 2
    reactions = read_reactions(tmp_path).to_pandas()["reaction"]
    assert reactions.isna().tolist() == [True] * 36 + [False] * (turn - 36)


def test_somebody_agrees_says_what_they_think_and_is_sent_back(page, tmp_path):
    """With the keyboard alone, on pages that break no rule of accessibility."""
    (tmp_path / "consent.md").write_text("# Taking part\n\nYou *may* stop <b>at any time</b>.")
    words = ["--condition", "CC3", "--no-practice", "--ask-structure"]
    words += ["--consent", str(tmp_path / "consent.md"), "--recruiting", "PID,STUDY"]
    words += ["--completion", "http://127.0.0.1:1/done"]
    with serving(tmp_path / "out", *words) as server:
        page.goto(f"{server.url}?PID=p7&STUDY=s1&OTHER=no")
        expect(page.locator("#consent-text h1")).to_have_text("Taking part")
        expect(page.locator("#consent-text p")).to_have_text("You may stop <b>at any time</b>.")
        assert violations(page) == []
        assert page.is_disabled("#consent-go")
        page.focus("#agree")
        page.keyboard.press("Space")
        page.focus("#consent-go")
        page.keyboard.press("Enter")
        page.click("#begin")
        page.click("#pause-go")
        levers = grey(page)
        for first, second in permutations(levers, 2):
            for action in (first, second, DOOR):
                click(page, action)
            if page.is_visible("#pause"):
                break
            page.wait_for_function("document.querySelector('#actions').textContent === '3'")
        page.click("#pause-go")
        page.wait_for_selector("#ask:not([hidden])")
        boxes = page.locator("#ask-levers input")
        assert boxes.count() == 9  # three levers: two others and the door for each
        assert violations(page) == []
        ticked = (levers[0], levers[2]), (levers[2], 7)
        for lever, other in ticked:
            page.focus(f'#ask-levers [data-lever="{lever}"][data-other="{other}"]')
            page.keyboard.press("Space")
        page.reload()  # the question is still there, and nothing is ticked yet
        page.wait_for_selector("#ask:not([hidden])")
        assert page.locator("#ask-levers input:checked").count() == 0
        for lever, other in ticked:
            page.check(f'#ask-levers [data-lever="{lever}"][data-other="{other}"]')
        page.click("#ask-go")
        page.wait_for_selector("#pause:not([hidden])")
        assert "Room 2 of 5" in page.inner_text("#pause-title")
        server.stop()
    pairs = read_answers(tmp_path / "out").to_pylist()
    assert {(pair["visit"], pair["cause"]) for pair in pairs} == {(1, lever) for lever in levers}
    assert {(pair["cause"], pair["effect"]) for pair in pairs if pair["enables"]} == {*ticked}
    told = (tmp_path / "out" / "recruited.csv").read_text()
    assert told == "join,PID,STUDY\n0,p7,s1\n"
