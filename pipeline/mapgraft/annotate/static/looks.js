// Which view is shown: both maps on each other, one and then the other, or what they say of each other.

import { keep, kept } from "./memory.js";

const BLINK_MS = 900;
const SAID = { overlay: "Both maps on each other", difference: "What they say of each other" };

// name(whose) gives the name of the own or the donor's robot, null where nothing is shown.
export function createLooks(stage, box, { chip, blinker, name, speak }) {
  let blinking = 0;

  function tell() {
    const { mode, alone } = stage.how;
    box.dataset.mode = mode;
    for (const button of document.querySelectorAll("[data-look]")) {
      button.setAttribute("aria-pressed", String(button.dataset.look === mode));
    }
    chip.textContent = mode === "swap" && name(alone) !== null ? `only ${name(alone)}` : "";
  }

  function look(mode) {
    const { alone, mode: before } = stage.how;
    const other = before === "swap" && alone === "own" ? "donor" : "own";
    if (mode !== "swap") stop();
    stage.setHow({ mode, alone: mode === "swap" ? other : "own" });
    tell();
    if (!blinking) speak(SAID[mode] ?? chip.textContent);
    keep("look", mode === "difference" ? mode : "overlay");
  }

  function stop() {
    clearInterval(blinking);
    blinking = 0;
    blinker.setAttribute("aria-pressed", "false");
  }

  function blink() {
    if (blinking) return stop();
    look("swap");
    if (matchMedia("(prefers-reduced-motion: reduce)").matches) return; // one press, one change
    blinking = setInterval(() => look("swap"), BLINK_MS);
    blinker.setAttribute("aria-pressed", "true");
  }

  if (kept("look") === "difference") look("difference");
  return { look, blink, tell };
}
