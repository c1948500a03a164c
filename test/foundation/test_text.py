from cdrj_ros.foundation.text import counted, fixed, printable


def test_control_characters_surrogates_and_line_breaks_are_escaped() -> None:
    assert printable("a\x1b[31mb\n\udc80\u202e") == "a\\x1b[31mb\\n\\udc80\\u202e"


def test_printable_characters_of_any_language_are_unchanged() -> None:
    assert printable("Seil 1 · câble – 索 µ") == "Seil 1 · câble – 索 µ"


def test_one_is_singular_and_zero_has_no_sign() -> None:
    assert [counted(number, "motor") for number in (0, 1, 2)] == ["0 motors", "1 motor", "2 motors"]
    assert [fixed(value, 1) for value in (-0.0, -0.04, 0.04, -0.06)] == [
        "0.0",
        "0.0",
        "0.0",
        "-0.1",
    ]
