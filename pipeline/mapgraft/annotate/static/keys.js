// One key, one action. Keys that are held with Ctrl, Alt or Meta belong to the browser; typing text is left alone.

const KEYS = {
  r: ["right"], w: ["wrong"], u: ["unsure"], z: ["undo"], n: ["skip"], " ": ["skip"],
  o: ["overlay"], s: ["swap"], b: ["blink"], d: ["difference"],
  f: ["fit"], v: ["view"], i: ["words"], t: ["note"], "?": ["help"],
  "+": ["zoom", 1.25], "=": ["zoom", 1.25], "-": ["zoom", 0.8], _: ["zoom", 0.8],
  ",": ["turn", 1], "[": ["turn", 1], "<": ["turn", 10], "{": ["turn", 10], // left is counter-clockwise
  ".": ["turn", -1], "]": ["turn", -1], ">": ["turn", -10], "}": ["turn", -10],
  0: ["reset"],
};
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
const WRITTEN_IN = "textarea, select, input:not([type=range]):not([type=checkbox])";
const PRESSED = "button, a, summary, input[type=checkbox]";

// Calls actions[name](…) for what is typed; `oneKey()` tells whether letters and digits answer.
export function listen(actions, { oneKey, open }) {
  document.addEventListener("keydown", (event) => {
    if (event.defaultPrevented || event.ctrlKey || event.altKey || event.metaKey || event.isComposing || open()) return;
    const target = event.target instanceof Element ? event.target : document.body;
    if (target.matches(WRITTEN_IN)) {
      if (event.key === "Escape") actions.leave();
      return;
    }
    const found = meant(event, target, oneKey());
    if (found === null) return;
    event.preventDefault();
    const [name, ...values] = found;
    if (event.repeat && !["step", "turn", "zoom"].includes(name)) return; // an answer is given once, however long it is held
    actions[name](...values);
  });
}

function meant(event, target, oneKey) {
  const { key } = event;
  if (key in ARROWS) {
    if (target.matches("input[type=range]")) return null;
    const [du, dv] = ARROWS[key];
    const far = event.shiftKey ? 10 : 1;
    return ["step", du * far, dv * far];
  }
  if (key === " " && target.matches(PRESSED)) return null;
  if (key.length !== 1 || !oneKey) return key === "?" ? ["help"] : null;
  if (key >= "1" && key <= "9") return ["pick", Number(key) - 1];
  return KEYS[key] ?? KEYS[key.toLowerCase()] ?? null;
}
