"""Code that may never answer: broken off in the main thread, left behind in others."""

import signal
import threading
import time

import pytest

from gvla2.planning.asking import DeadlineError, within


def busy():
    while True:
        pass


@pytest.mark.parametrize("never", [busy, lambda: time.sleep(60)], ids=["busy", "asleep"])
def test_what_never_answers_is_broken_off(never):
    began = time.monotonic()
    with pytest.raises(DeadlineError, match=r"0\.2 s"):
        within(0.2, never)
    assert time.monotonic() - began < 5.0


def test_code_that_swallows_its_end_is_reported_again():
    reported = []

    def deaf():
        while True:
            try:
                time.sleep(60)
            except BaseException:
                reported.append(1)
                if len(reported) > 1:
                    raise

    with pytest.raises(DeadlineError):
        within(0.1, deaf)
    assert len(reported) == 2


def test_answers_and_errors_pass_through():
    assert within(5.0, lambda: 3) == 3
    assert within(0, lambda: 4) == 4
    with pytest.raises(ZeroDivisionError):
        within(5.0, lambda: 1 / 0)


def test_somebody_elses_alarm_goes_on():
    rung = []
    before = signal.signal(signal.SIGALRM, lambda *_: rung.append(1))
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.3)
        with pytest.raises(DeadlineError):
            within(0.1, busy)
        time.sleep(1.0)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
    assert rung == [1]


def test_in_another_thread_it_is_left_behind():
    seen = []
    free = threading.Event()

    def ask():
        seen.append(within(5.0, lambda: 7))
        for function in (lambda: 1 / 0, free.wait):
            try:
                within(0.2, function)
            except (ZeroDivisionError, DeadlineError) as error:
                seen.append(type(error))

    thread = threading.Thread(target=ask)
    thread.start()
    thread.join(20)
    free.set()
    assert seen == [7, ZeroDivisionError, DeadlineError]
