"""A page on which a scene is moved, differentiated and recovered with the mouse.

    the page (static/*.js)                a browser, or a cell of a notebook
        |  ^   messages (messages.py)     {"kind": "drag", "x": 0.4, "y": 0.5, ...}
        v  |   frames and replies         pictures as JPEG, and the numbers that they show
    server.py -- worker.py                a browser's: an event loop, and one thread that renders,
                                          in a process that is started again (serve.py, serving.py)
    notebook.py                           a notebook's: the kernel's own thread
        |  ^
        v  |
    session.py                            does what messages say, and makes frames of the state
        |-- actions.py                    what each message does (mouse.py, history.py, saving.py)
        |-- recovery.py                   targets and fits (fitting.py: in a process of its own)
        |-- state.py                      the scene, what is picked, how it is looked at
        '-- pictures.py                   scene -> pictures (colors.py, marks.py)

The state is on this side; a page only shows it. A message changes the state, and the next frame has
the picture of it, with all numbers that differ from those of the scene's file. So a page that was
away needs one frame to be up to date, and frames may be left out.

Nothing queues up. The worker takes all messages that wait; of those that only say where the mouse
is, the last one counts. Then it renders once. At most two frames are on the way to a page, which
says when it has shown one. While something moves, a picture has one sample a pixel. When the mouse
rests, the page says so, and gets one with the samples and edges that were asked for; the next
message interrupts that one between two bands of rows.

Numbers that move compile nothing: kernels take them as inputs. Only a parameter that was left out
of the kernels, such as a weight of 0, needs new ones: the page announces a slider that is touched,
and kernels are compiled before it moves.

A page reaches nothing but this. The server listens on 127.0.0.1, takes only requests to itself
(`Host`), from its own page (`Origin`), with the token of its address (guard.py). It writes one kind
of file: what is saved, by name, into the scene's folder.

The function `whitted.view` has the name of this room. Its modules are imported by their whole
names, as in `from whitted.view.session import Session`.
"""
