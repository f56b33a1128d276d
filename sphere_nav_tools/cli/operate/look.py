"""How the page looks, and the few lines that run in the browser: a stop in sight, lost connections, held buttons."""

from __future__ import annotations

STYLE = """
#sn-stop {position:fixed; z-index:10000; left:12px; bottom:12px; width:300px; height:76px; font:700 23px sans-serif;
  border-radius:10px; background:#c92a2a; color:white; border:3px solid white; cursor:pointer;
  touch-action:manipulation}
.mantine-Notifications-root {inset:auto auto 168px 12px !important}
.sn-state {position:fixed; z-index:900; left:12px; top:12px; width:420px; max-width:calc(100vw - 48px);
  padding:10px 14px; border-radius:10px; background:var(--mantine-color-body);
  box-shadow:0 1px 6px #0006; font:15px sans-serif}
.sn-word {font-size:34px; font-weight:800; line-height:1.15; padding:0 10px; border-radius:6px; color:white}
.sn-scale {position:fixed; z-index:800; left:12px; bottom:104px; font-size:13px; font-weight:600; padding:2px 8px;
  background:var(--mantine-color-body); border-radius:6px}
.sn-scale i {display:inline-block; height:6px; border:2px solid currentColor; border-top:0; margin-right:6px}
.sn-scale svg {vertical-align:middle; margin-left:10px}
.sn-scale span {white-space:nowrap}
.sn-log {max-height:11em; overflow-y:auto}
.sn-refused {margin:0 1em 0.6em; padding:6px 10px; border:2px solid #c92a2a; border-radius:6px; font-weight:600}
.mantine-Paper-root:has(#sn-beat) label {color:var(--mantine-color-text) !important}
#sn-lost {position:fixed; z-index:10001; left:12px; bottom:100px; width:640px; padding:14px;
  background:#c92a2a; color:white;
  font:700 18px sans-serif; display:none; text-align:center}
@media (max-width: 576px) {
  #sn-stop {left:8px; right:8px; top:8px; bottom:auto; width:calc(100vw - 16px); height:64px}
  .sn-state {left:8px; top:80px; width:calc(100vw - 16px); max-width:none; padding:8px 10px; font-size:13px}
  .sn-word {font-size:26px}
  .sn-log {max-height:4.2em; overflow-y:auto}
  .sn-scale {left:8px; bottom:calc(40% + 8px); font-size:11px}
  #sn-lost {left:8px; right:8px; top:76px; bottom:auto; width:auto}
  .mantine-Paper-root:has(#sn-beat) {width:100vw !important; max-height:40% !important}
  .mantine-Notifications-root {inset:230px auto auto 8px !important}
  .mantine-Paper-root:has(#sn-beat) .mantine-ScrollArea-viewport > div > div {width:100% !important}
}
"""
# The stop belongs to the document, not to the panel, and asks by a connection of its own; a held button is let go when
# the window loses the focus. It stands in an attribute: a bare addEventListener would be that of the picture.
SCRIPT = """
(() => {
  if (window.sphereNav) return; window.sphereNav = 1;
  const token = location.pathname.split('/')[1];
  const put = (kind, id) => document.documentElement.appendChild(Object.assign(document.createElement(kind), {id}));
  put('style', 'sn-style').textContent = document.getElementById('sn-dress').textContent;
  const lost = put('div', 'sn-lost'), stop = put('button', 'sn-stop'), name = 'EMERGENCY STOP';
  const state = put('div', 'sn-folded');  // while the panel is folded; the banner's HTML, in which all words are text
  lost.textContent = 'NO CONNECTION: what you see is old. Press ' + name + ', or the button on the vehicle';
  stop.textContent = name;
  let told = 0;
  const tell = text => { stop.textContent = text; told = Date.now(); };
  const ask = e => { e.stopPropagation(); tell('asking ...');
    fetch('/' + token + '/emergency_stop', {cache: 'no-store', keepalive: true}).then(
      r => tell(r.ok ? name + ' asked for' : 'REFUSED: press on vehicle'),
      () => tell('NOT REACHED: press on vehicle')); };
  stop.addEventListener('pointerdown', ask);
  stop.addEventListener('click', e => { if (!e.detail) ask(e); });
  const drop = () => document.querySelectorAll('button').forEach(
    b => b.dispatchEvent(new PointerEvent('pointercancel', {bubbles: true})));
  window.addEventListener('blur', drop); document.addEventListener('visibilitychange', drop);
  window.addEventListener('contextmenu', e => { if (e.target.closest('button')) e.preventDefault(); });
  let beat = '', heard = Date.now(), asks = false;
  const hear = text => { heard = Date.now(); state.innerHTML = text; };
  setInterval(() => {
    const now = document.getElementById('sn-beat');  // none while the panel is folded: then the server is asked
    if (!now && !asks && Date.now() - heard > 500) {
      asks = true;
      fetch('/' + token + '/state', {cache: 'no-store', signal: AbortSignal.timeout(2000)}).then(
        r => r.ok && r.text().then(hear)).catch(() => 0).finally(() => { asks = false; });
    }
    if (now && now.dataset.beat !== beat) { beat = now.dataset.beat; hear(''); }
    if (Date.now() - told > 3000)
      stop.textContent = now && now.dataset.pressed && lost.style.display !== 'block' ? name + ' is pressed' : name;
    lost.style.display = Date.now() - heard > 3000 ? 'block' : 'none';
  }, 250);
})()
"""


def dressing() -> str:
    """Return HTML that dresses the page and puts the stop into it."""
    return f'<style id="sn-dress">{STYLE}</style><img src="data:," style="display:none" onerror="{SCRIPT}">'
