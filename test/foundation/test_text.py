from cdrj_ros.foundation.output import printable


def test_control_characters_surrogates_and_line_breaks_are_escaped() -> None:
    assert printable("a\x1b[31mb\n\udc80\u202e") == "a\\x1b[31mb\\n\\udc80\\u202e"


def test_printable_characters_of_any_language_are_unchanged() -> None:
    assert printable("Seil 1 · câble – 索 µ") == "Seil 1 · câble – 索 µ"
