"""Names in a text: "room 12", "python 3.11", "bin B", "cam-0", "--fix".

They measure nothing; where they differ, two texts speak of two things.
"""

from __future__ import annotations

import re

from gvla2.memory.indexing.stop_words import STOP_WORDS

_VERSIONED = (
    "python|numpy|scipy|pandas|torch|pytorch|tensorflow|jax|cuda|cudnn|driver|node|nodejs|npm|java|jdk|kotlin|scala|php|ruby"
    "|golang|rust|gcc|clang|llvm|cmake|gradle|maven|ros|ros2|gazebo|moveit|opencv|django|flask|fastapi|react|angular|vue"
    "|postgres|postgresql|mysql|mariadb|sqlite|redis|mongodb|kafka|docker|kubernetes|helm|terraform|ansible|nginx|apache"
    "|ubuntu|debian|fedora|centos|linux|windows|macos|android|ios|kernel|usb|hdmi|bluetooth|ipv|tls|ssl|http|openssl|api|sdk"
    "|firmware|bios|version|versions|release|revision|rev|build|chrome|firefox|safari|pip|poetry|conda|pytest|ruff|mypy|git"
    "|bash|perl|swift|unity|unreal|spark|hadoop|airflow|celery|rails|laravel|spring|typescript|eslint|webpack|vite|qt|glibc"
)
_NAMED = (
    "room|rooms|bay|issue|ticket|bug|pr|case|gate|platform|station|cell|locker|slot|socket|rack|aisle|floor|building|hall"
    "|unit|invoice|serial|part|model|type|class|chapter|section|paragraph|figure|table|appendix|page"
    "|joint|joints|axis|servo|motor|sensor|camera|robot|arm|drawer|shelf|bin|tray|lane|zone|sector|site|patient|user"
    "|server|host|machine|line|lines|row|rows|column|columns|step|steps|phase|round|trial|episode|experiment|scene"
    "|highway|route|bus|flight"
)
_NO_BOUND = (
    r"(?!\s*(?:[%°]|or\b|and (?:above|up|later|newer)|[a-z]+/|mm|cm|m?s\b|[mn]\b|kg|\+"
    r"|(?:sec|min|hour|day|week|times|second)[a-z]*\b))"
)
_NO_MEASURE = (
    r"(?![\w%.,:]*\d)(?!\s*-?\s?(?:[%°]|(?:mm|cm|m|s|ms|n|nm|g|b|[kmg]b|hz|px|or|x|times|min|mins)\b"
    r"|kg|deg|met|cent|mill|sec|hour|minu|inch|grad|newt|volt|bolt|gram))"
)
_NAMES = re.compile(
    # 2024-03-01, 01.03.2024
    r"(?<![\w.])(?:\d{4}[-/.]\d{1,2}[-/.]\d{1,2}|\d{1,2}[./]\d{1,2}[./]\d{4})(?!\w)"
    # addresses, and versions of three parts and more
    r"|(?<![\w.,])v?\d+(?:\.\d+){2,}(?:[-.]?[a-z]+[\w.]*)?(?::\d+)?(?!\w)"
    # v1.2, v2
    r"|(?<![\w.])v\d+(?:\.\d+)*[a-z]*\d*(?!\w)"
    rf"|(?<!\w)(?P<product>(?:{_VERSIONED})[ -]?)"
    rf"(?P<version>(?>v?\d+(?:\.(?:\d+|x))*(?:[-.]?(?:rc|alpha|beta|a|b|dev|lts)\d*)?))(?!\w){_NO_BOUND}"
    rf"|(?<!\w)(?P<thing>(?:{_NAMED}) (?:no\.? |nr\.? |number )?)"
    rf"(?P<which>(?>#?\d+(?:\.\d+)?[a-z]?)){_NO_MEASURE}"
    # phone numbers and other rows of groups
    r"|(?<![\w.])\+\d{1,3}(?:[- ]\d{2,5}){2,}(?!\w)|(?<![\w.])0\d{2,5}(?:[- /]\d{2,8}){1,3}(?!\w)"
    # abc-1042, a-17, usb-c; not utf-8 and its like, which are chosen by their number
    r"|(?<![\w-])(?!(?:utf|sha|aes|md|rsa)-)(?:[a-z]{1,6}-\d+[a-z]?(?:-\w+)*|usb-[a-c]|[a-z]\d+-\w+)(?!\w)"
    # #42
    r"|(?<!\w)#\d+(?!\w)"
    # 7bd02aa, 3fa9c1e, m6x20: digits and letters that are no figure and its unit
    r"|(?<![\w.,/])(?P<mixed>\d+[a-z]+\d[\da-z]*|[a-z]+\d+[a-z]+\w*|[a-z]+\d+(?:[._-]\d+)+)(?!\w)"
)
_FIGURE = re.compile(r"\d+[x×]\d+(?:[x×]\d+)?(?:[mcµ]?m|px)?$|\d+(?:e-?\d+|[µmckd]?m[23])$")
_DIGITS = re.compile(r"\d+")
_BEFORE = frozenset((*_VERSIONED.split("|"), *_NAMED.split("|"), "no", "no.", "nr", "nr.", "number"))
_JOIN = re.compile(r"\W+")


def name_things(text: str) -> str:
    """A casefolded text in which each name with a number is one word: "python 3.11" becomes "python nr3_11".

    Words that begin with "nr" agree only where they are equal. A version with a bound ("2.1 or newer") stays a number.
    """
    return _NAMES.sub(_named, text) if _may_name(text) else text


def _may_name(text: str) -> bool:
    """Whether there may be a name at all: quicker than to look for one, and most texts have none."""
    last, joined = -9, False
    for digits in _DIGITS.finditer(text):
        start, end = digits.span()
        before = text[start - 1] if start else ""
        if "a" <= before <= "z" or before in ("#", "+") or (end - start > 2 and text[start] == "0"):
            return True
        if before == "-" and start > 1 and text[start - 2].isalpha():
            return True
        if last >= 0 and text[last:start].isalpha():
            return True  # "7bd02"
        if before == " " or before == "-":
            words = text[max(0, start - 16) : start - 1].split()
            if words and words[-1] in _BEFORE:
                return True
        linked = start - last == 1 and before in ".-/:"
        if linked and joined:
            return True  # "1.2.3"
        last, joined = end, linked
    return "usb-" in text


def _named(match: re.Match[str]) -> str:
    if match["version"]:
        return f"{match['product'].rstrip(' -')} {_one_word(match['version'])}"
    if match["which"]:
        return f"{match['thing']}{_one_word(match['which'])}"
    if match["mixed"] and (match["mixed"].startswith("nr") or _FIGURE.match(match["mixed"])):
        return match.group()
    return _one_word(match.group())


def _one_word(name: str) -> str:
    return "nr" + _JOIN.sub("_", name).strip("_")


_LINKED = re.compile(
    r"#\s?\d+|(?<![\w-])--[A-Za-z][\w-]*"
    r"|(?<![\w.,-])(?!(?i:utf|sha|aes|md|rsa)-)[^\W\d_]+(?:[-_/][^\W\d_]+)*[-_/]\d[\w/-]*(?:\.\w+)*"
    r"|(?<=[^\W_]-)[A-Za-z](?![\w'’])"
    r"|(?<![\w'’])[A-Za-z](?=-[^\W_])"
    r"|(?<=\s-)[A-Za-z](?![\w'’])"
)
"""What hyphens, slashes and "#" join: "build-07", "release/1.4", "USB-A", "x-axis", "-j", "--fix". Not "UTF-8" and its
like: they are chosen by their number.
"""
_LETTER = re.compile(r"(?<=[a-z] )(?:[A-HJ-Zbcdfghjkpqrvwxz]|[A-Z]{2,4})(?![\w'’%°/]|\.\s?\w)")
"""A letter that stands alone within a sentence, "bin B", "along z", or a short name, "in CI"."""
_GAP = re.compile(r"[\W_]+")


def marked(text: str) -> str:
    """The text with such names as words of their own that no other word resembles."""
    if "-" in text or "/" in text or "#" in text or "_" in text:
        text = _LINKED.sub(_marked, text)
    return _LETTER.sub(_letter, text)


def _letter(found: re.Match[str]) -> str:
    text = found.group()
    return _marked(found) if len(text) == 1 or text.casefold() in STOP_WORDS else text


def _marked(found: re.Match[str]) -> str:
    # The separators stay: "release/1.4" is not "release/14".
    return f" nr{_GAP.sub('_', found.group()).strip('_')}0 "
