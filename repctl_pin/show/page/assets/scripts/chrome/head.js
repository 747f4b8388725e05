// The head of the page: its title, its sentence and its notes, and the room that it takes.

import { byId, element, setAttribute, setText } from "../dom.js";

const FOOT = 8; // px to leave free under the notes
const LOWEST = 480; // px, height of a window below which notes are not in sight
// the longest of a loop, but for those of several hands
const LOOP_TITLE = "your loop, 88 cm long so far, 88° from horizontal";

export class Head {
  // `subject`: begins the titles; `longest`: by node, its longest words while a hand is led;
  // `more`: what the sentence of a loop has after that of a study; `unnoted`: and besides, where
  // notes are not in sight
  constructor(subject, longest, more, unnoted) {
    const texts = ["title", "verdict", "notes"].map((id) => [byId(id), [...byId(id).childNodes]]);
    const study = byId("title").textContent;
    Object.assign(this, { subject, longest, more, unnoted, texts, study });
  }

  write(sentence, notes, title) {
    const part = ([text, kind]) =>
      kind === undefined ? text : element("b", { class: kind }, text);
    byId("verdict").replaceChildren(...sentence.map(part));
    const note = ([text, kind]) => element("span", { class: kind || "" }, text);
    if (notes) byId("notes").replaceChildren(...notes.map(note));
    if (title) this.entitle(title);
    this.fold();
  }

  entitle(words) {
    const title = `${this.subject}: ${words}`;
    setText(byId("title"), title);
    setAttribute(byId("title"), "title", title);
    this.name(title);
  }

  // Name the window and the animation after what they show.
  name(title) {
    const panes = byId("panes");
    const label = panes.getAttribute("aria-label");
    setAttribute(
      panes,
      "aria-label",
      label.replace(this.named || this.study, () => title),
    );
    document.title = title;
    this.named = title;
  }

  // Say again what is said of the study.
  restore() {
    for (const [node, children] of this.texts) node.replaceChildren(...children);
    byId("title").removeAttribute("title");
    this.name(this.study);
  }

  // Show as many lines of a loop's notes as there is room for under its sentence, and a button for
  // all of them, which then stand beside the views.
  fold() {
    const { height } = this;
    const { classList } = document.body;
    const [notes, more, verdict] = ["notes", "more", "verdict"].map(byId);
    const [header] = document.getElementsByTagName("header");
    const own = classList.contains("own");
    // what is said of a loop has the room of the head, whatever its sentence takes of it
    notes.style.minHeight = own ? "0" : this.notesHeight;
    verdict.style.minHeight = own ? this.verdictHeight : this.studyHeight;
    notes.style.maxHeight = "";
    // a sentence that is longer than any of a study or a gesture
    const isTall = () => height && verdict.offsetTop + verdict.offsetHeight > height + 1;
    const [proof] = verdict.getElementsByClassName("proof");
    if (proof) proof.hidden = true;
    classList.toggle("tall", isTall());
    const open = classList.contains("unfolded");
    const clear = () => notes.offsetTop + notes.scrollHeight <= height - FOOT;
    header.classList.remove("cut");
    const room = notes.offsetHeight && !classList.contains("noted");
    const folded = own && height && room && !clear();
    header.classList.toggle("cut", Boolean(folded));
    more.textContent = open ? "Fewer notes" : "All notes";
    more.setAttribute("aria-expanded", String(open));
    // what is proved is a note, and a clause of the sentence where that note is not in sight
    if (proof && !open && (folded || !notes.offsetHeight)) {
      proof.hidden = false;
      // one that has no room reserved is left to the notes, where it would move the views
      const reserved = proof.textContent === this.unnoted && window.innerHeight > LOWEST;
      proof.hidden = isTall() && !reserved;
      classList.toggle("tall", isTall());
    }
    if (!folded || open) return;
    const line = parseFloat(getComputedStyle(notes).lineHeight);
    const lines = Math.floor((height - FOOT - notes.offsetTop) / line + 0.01);
    notes.style.maxHeight = `${Math.max(lines, 0) * line}px`;
  }

  // Give sentence and notes the room of the longest words of a gesture, so that nothing moves when
  // they change; what is said of a loop takes the same room.
  reserve() {
    this.measure();
    this.fold();
  }

  // The height of the head with the study's words and with those of a gesture.
  measure() {
    const { body } = document;
    const [header] = document.getElementsByTagName("header");
    this.height = 0;
    if (!header.clientWidth) return;
    const nodes = this.texts.map(([node]) => node);
    const now = nodes.map((node) => [...node.childNodes]);
    const classes = body.className;
    body.classList.remove("own", "leading", "unfolded");
    header.classList.remove("cut");
    for (const [node, children] of this.texts) {
      Object.assign(node.style, { minHeight: "", maxHeight: "" });
      node.replaceChildren(...children);
    }
    for (const [id, words] of Object.entries(this.longest)) {
      const node = byId(id);
      const children = [...node.childNodes];
      const before = node.clientHeight;
      node.replaceChildren(...words.map((text) => element("span", {}, text)));
      let height = Math.max(before, node.clientHeight);
      if (id === "verdict") {
        // a phone that lies has no line to spare
        const noted = byId("notes").offsetHeight || window.innerHeight <= LOWEST;
        const more = this.more + (noted ? "" : this.unnoted);
        node.replaceChildren(...children, element("b", { class: "aside" }, more));
        height = Math.max(height, node.clientHeight);
      }
      node.replaceChildren(...children);
      if (height) node.style.minHeight = `${height}px`;
    }
    const [[title], [verdict], [notes]] = this.texts;
    body.style.setProperty("--title", `${title.offsetWidth}px`);
    const tall = title.offsetHeight;
    // the title of a loop may need one line more: a study's sentence has its room
    const titled = [...title.childNodes];
    title.textContent = `${this.subject}: ${LOOP_TITLE}`;
    body.classList.add("own");
    const more = Math.max(title.offsetHeight - tall, 0);
    body.classList.remove("own");
    title.replaceChildren(...titled);
    title.style.minHeight = `${tall}px`;
    this.notesHeight = notes.style.minHeight;
    this.verdictHeight = verdict.style.minHeight;
    this.studyHeight = `calc(${this.verdictHeight || "0px"} + ${more}px)`;
    verdict.style.minHeight = this.studyHeight;
    this.height = header.getBoundingClientRect().height;
    body.style.setProperty("--head", `${this.height}px`);
    nodes.forEach((node, k) => node.replaceChildren(...now[k]));
    body.className = classes;
  }
}
