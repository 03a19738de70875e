// Tells screen readers what has happened, one sentence after the other, the same sentence twice as well.

export function said(region) {
  let flip = false;
  return (sentence) => {
    flip = !flip;
    region.textContent = flip ? sentence : `${sentence}\u00a0`; // a change, even if the words are the same
  };
}
