"""Every action by keyboard, and the list of the keys."""

FOCUS = """() => {
  const focused = document.activeElement, style = getComputedStyle(focused);
  const name = focused.id || (focused === document.body ? "body" : focused.textContent.trim());
  return [name, style.outlineStyle, parseFloat(style.outlineWidth)];
}"""
SHORTCUTS = """() => [...document.querySelectorAll("[aria-keyshortcuts]")]
  .flatMap(it => it.getAttribute("aria-keyshortcuts").split(" "))"""
SIGNS = {"arrowleft": "\u2190", "arrowright": "\u2192", "-": "\u2212"}


def test_the_list_of_keys_names_every_shortcut_and_takes_no_other_key(shown):
    shown.keyboard.press("r")
    shown.keyboard.press("?")
    keys = shown.locator("#keys")
    assert keys.is_visible()
    named = [text.lower() for text in keys.locator("kbd").all_text_contents()]
    wanted = {key.lower() for key in shown.evaluate(SHORTCUTS)}
    assert {SIGNS.get(key, key) for key in wanted} <= set(named)
    # The keys of the page have no effect, and Escape closes the list alone.
    shown.keyboard.press("h")
    assert shown.locator("#heatmap-button").get_attribute("aria-pressed") == "false"
    shown.keyboard.press("Escape")
    assert keys.is_hidden()
    assert shown.locator("#drawn").is_visible()
    shown.locator("#keys-button").press("Enter")
    assert keys.is_visible()
    keys.get_by_role("button").press("Enter")
    assert keys.is_hidden()
    # The focus goes back to where it was.
    assert shown.evaluate("() => document.activeElement.id") == "keys-button"


def test_escape_discards_the_box_that_the_button_has_begun(shown):
    shown.locator("#draw").press("Enter")
    assert shown.locator("#drawn").is_visible()
    shown.keyboard.press("Escape")
    assert shown.locator("#drawn").is_hidden()
    assert shown.evaluate("() => document.activeElement.id") == "draw"


def test_the_focus_is_visible_everywhere_and_never_trapped(shown):
    shown.locator("#groups details").first.wait_for()
    shown.evaluate("() => { document.querySelector('#groups details').open = true; }")
    names = []
    for _ in range(150):
        shown.keyboard.press("Tab")
        name, style, width = shown.evaluate(FOCUS)
        if name == "body" and names:
            # Beyond the last control is the browser itself.
            break
        assert style != "none", name
        assert width >= 1, name
        names.append(name)
    assert {"timeline", "zoom-in", "draw", "keys-button"} <= set(names)
    assert name == "body"
