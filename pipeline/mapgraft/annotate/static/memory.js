// What this browser remembers between visits: habits of looking, nothing of the maps or the answers.

export function kept(name) {
  try {
    return localStorage.getItem(`mapgraft.${name}`);
  } catch {
    return null; // storage is switched off
  }
}

export function keep(name, value) {
  try {
    localStorage.setItem(`mapgraft.${name}`, value);
  } catch {
    // it is chosen anew on the next visit
  }
}
