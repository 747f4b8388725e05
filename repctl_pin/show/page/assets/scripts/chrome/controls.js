// Hands: buttons, the slider, and keys, which work wherever the focus is.

import { byId, element, setAttribute, setText } from "../dom.js";

// Gives a function that makes them say where time is: `done` cycles finished, and the part of the
// next.
export function connect(clock, view) {
  rule(clock);
  const seek = (time) => {
    clock.play(false);
    clock.seek(time);
  };
  byId("play").addEventListener("click", () => clock.press());
  byId("scrub").addEventListener("input", (event) => seek(event.target.value));
  byId("speed").addEventListener("change", (event) => {
    clock.speed = Number(event.target.value);
    event.target.blur();
  });
  byId("stepping").addEventListener("change", ({ target }) => {
    clock.step(target.checked);
    clock.play(true);
  });
  const keys = () => {
    byId("keys").showModal();
    byId("keys").scrollTop = 0;
  };
  byId("noted").addEventListener("click", ({ currentTarget }) =>
    currentTarget.setAttribute("aria-expanded", openNotes("noted")),
  );
  byId("help").addEventListener("click", keys);
  const menus = ["looks", "save", "loops"].map(byId);
  const closeMenus = (pressed) => {
    for (const menu of menus) if (!menu.contains(pressed)) menu.open = false;
  };
  document.addEventListener("pointerdown", ({ target }) => closeMenus(target));
  // what is pressed in the page around this one is not seen here
  window.addEventListener("blur", () => closeMenus(null));
  for (const menu of menus) menu.addEventListener("toggle", () => insideWindow(menu));
  window.addEventListener("resize", () => menus.forEach(insideWindow));
  byId("view").addEventListener("click", view.reset);
  byId("enlarge").addEventListener("click", ({ currentTarget }) =>
    view.enlarge(currentTarget.getAttribute("aria-pressed") !== "true"),
  );
  byId("show-joints").addEventListener("change", ({ target }) => view.joints(target.checked));
  for (const name of ["traces", "ghost", "fan", "drift", "callouts"])
    byId(`show-${name}`).addEventListener("change", (event) =>
      view.set(name, event.target.checked),
    );
  // what a pointer has pressed does not keep the keys
  document.addEventListener("pointerup", (event) => {
    if (event.target.closest("footer button, footer label.switch, #scrub, #chart"))
      setTimeout(() => document.activeElement.blur());
  });
  document.addEventListener("keydown", (event) => {
    const { target, key } = event;
    if (event.ctrlKey || event.metaKey || event.altKey || target.closest("select, dialog, #notes"))
      return;
    // it is what presses them
    if (key === " " && target.closest("button, summary, input[type=checkbox]")) return;
    const turns = {
      ArrowLeft: [-0.1, 0],
      ArrowRight: [0.1, 0],
      ArrowUp: [0, -0.1],
      ArrowDown: [0, 0.1],
    };
    const hop = clock.stepping || target.id === "chart" ? 1 : 1 / 60;
    const whole = target.id === "chart" ? Math.round : Number;
    const does =
      event.shiftKey && turns[key]
        ? () => view.turn(...turns[key])
        : {
            " ": () => clock.press(),
            ArrowRight: () => seek(whole(clock.time) + hop),
            ArrowLeft: () => seek(whole(clock.time) - hop),
            PageDown: () => seek(Math.floor(clock.time + 1)),
            PageUp: () => seek(Math.ceil(clock.time - 1)),
            Home: () => seek(0),
            End: () => seek(clock.cycles),
            "+": () => view.turn(0, 0, 1.1),
            "-": () => view.turn(0, 0, 1 / 1.1),
            "?": keys,
          }[key];
    if (does) {
      event.preventDefault();
      does();
    }
  });

  return (done, part) => {
    const { last, whole } = clock;
    const inside = part > 0 && part < 1;
    const within = whole ? `cycle ${done + 1} of ${last}` : "on the way";
    // while only these are shown, they are called so
    const stepped = clock.playing && clock.stepping;
    const ends = stepped ? `end of cycle ${done}` : `after ${done} of ${last}`;
    const after = whole ? ends : "as far as it goes";
    const words = inside ? within : done ? after : "start";
    const { ended } = clock;
    document.body.classList.toggle("playing", clock.playing && !ended);
    document.body.classList.toggle("ended", ended);
    setAttribute(byId("play"), "aria-label", ended ? "Replay" : clock.playing ? "Pause" : "Play");
    byId("stepping").checked = clock.stepping;
    setText(byId("clock"), words);
    byId("scrub").value = clock.time;
    setAttribute(
      byId("scrub"),
      "aria-valuetext",
      inside
        ? `${words}, ${Math.round(100 * part)} %`
        : done && whole && !stepped
          ? `${words} cycles`
          : words,
    );
  };
}

// Open the notes, which then may scroll, by keys too, or close them; whether they are open.
export function openNotes(name) {
  const open = document.body.classList.toggle(name);
  byId("notes").tabIndex = open ? 0 : -1;
  return open;
}

// Shift an open menu, and let it scroll, so that all of it can be reached.
function insideWindow(menu) {
  if (!menu.open) return;
  const { style } = menu.lastElementChild;
  style.right = "0";
  style.maxHeight = `${menu.lastElementChild.offsetParent.getBoundingClientRect().top - 16}px`;
  style.right = `${Math.min(menu.lastElementChild.getBoundingClientRect().left - 8, 0)}px`;
}

// The slider's length and its marks.
export function rule({ cycles }) {
  byId("scrub").max = cycles;
  byId("ticks").replaceChildren(
    ...(cycles > 1
      ? Array.from({ length: cycles + 1 }, (_, c) =>
          element("i", { style: `left: ${(100 * c) / cycles}%` }),
        )
      : []),
  );
}
