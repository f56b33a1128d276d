"""How the page looks, and the few lines that run in the browser: a stop in sight, lost connections, held buttons."""

from __future__ import annotations

STYLE = """
#STOP {position:fixed; z-index:10000; left:12px; bottom:12px; width:300px; height:76px !important; font-size:23px;
  font-weight:700; border-radius:10px; background:#c92a2a; color:white; border:3px solid white}
#STOP svg {margin-right:8px}
.mantine-Notifications-root {inset:auto auto 150px 12px !important}
.sn-state {position:fixed; z-index:900; left:12px; top:12px; width:420px; max-width:calc(100vw - 48px);
  padding:10px 14px; border-radius:10px; background:var(--mantine-color-body);
  box-shadow:0 1px 6px #0006; font-size:15px}
.sn-word {font-size:34px; font-weight:800; line-height:1.15; padding:0 10px; border-radius:6px; color:white}
.sn-past {position:fixed; z-index:900; left:326px; bottom:12px; width:min(560px, calc(100vw - 800px)); height:76px;
  padding:8px 10px; border-radius:10px; background:var(--mantine-color-body);
  box-shadow:0 1px 6px #0006; font-size:12px}
.sn-bar {position:relative; height:30px; background:#8883; border-radius:4px; overflow:hidden}
.sn-bar div {position:absolute; top:0; bottom:0}
.sn-scale {position:fixed; z-index:800; left:12px; bottom:104px; font-size:13px; font-weight:600; padding:2px 8px;
  background:var(--mantine-color-body); border-radius:6px}
.sn-scale i {display:inline-block; height:6px; border:2px solid currentColor; border-top:0; margin-right:6px}
.sn-scale svg {vertical-align:middle; margin-left:10px}
#sn-lost {position:fixed; z-index:10001; left:12px; bottom:100px; width:640px; padding:14px; cursor:pointer;
  background:#c92a2a; color:white;
  font:700 18px sans-serif; display:none; text-align:center}
@media (max-width: 576px) {
  #STOP {left:8px; right:8px; top:8px; bottom:auto; width:calc(100vw - 16px); height:64px !important}
  .sn-state {left:8px; top:80px; width:calc(100vw - 16px); max-width:none; padding:8px 10px; font-size:13px}
  .sn-word {font-size:26px}
  .sn-past {position:static; width:auto; height:auto; box-shadow:none}
  .sn-scale {left:8px; bottom:calc(40% + 8px)}
  #sn-lost {left:8px; right:8px; top:76px; bottom:auto; width:auto}
  .mantine-Paper-root div:has(#STOP) {display:block !important; transform:none !important}
  .mantine-Paper-root:has(#STOP) {width:100vw !important; max-height:40% !important}
  .mantine-Notifications-root {inset:230px auto auto 8px !important}
  .mantine-Paper-root:has(#STOP) .mantine-ScrollArea-viewport > div > div {width:100% !important}
}
"""
# A held button is let go when the window loses the focus; the stop is also asked for by a connection of its own.
SCRIPT = """
(() => {
  if (window.sphereNav) return; window.sphereNav = 1;
  const token = location.pathname.split('/')[1], lost = document.createElement('div');
  const ask = () => fetch('/' + token + '/emergency_stop', {cache: 'no-store', keepalive: true});
  lost.id = 'sn-lost'; document.body.appendChild(lost);
  lost.onclick = () => { lost.textContent = 'asking ...';
    ask().then(r => { lost.textContent = r.ok ? 'EMERGENCY STOP was asked for' : 'REFUSED'; },
               () => { lost.textContent = 'NOT REACHED: use the button on the vehicle'; }); };
  addEventListener('pointerdown', e => { if (e.target.closest('#STOP')) ask().catch(() => 0); }, true);
  const drop = () => document.querySelectorAll('button').forEach(
    b => b.dispatchEvent(new PointerEvent('pointercancel', {bubbles: true})));
  addEventListener('blur', drop); document.addEventListener('visibilitychange', drop);
  addEventListener('contextmenu', e => { if (e.target.closest('button')) e.preventDefault(); });
  let beat = '', heard = Date.now();
  setInterval(() => {
    const now = document.getElementById('sn-beat');
    if (now && now.dataset.beat !== beat) { beat = now.dataset.beat; heard = Date.now(); }
    const isLost = Date.now() - heard > 3000;
    if (isLost && lost.style.display !== 'block')
      lost.textContent = 'NO CONNECTION: press here for EMERGENCY STOP, or the button on the vehicle';
    lost.style.display = isLost ? 'block' : 'none';
  }, 250);
})()
"""


def dressing(stop: str) -> str:
    """Return HTML that dresses the page; `stop`: the id of the button that is always in sight."""
    script, style = (text.replace("#STOP", f"[id=\\'{stop}\\']") for text in (SCRIPT, STYLE))
    style = style.replace("\\", "")
    return f'<style>{style}</style><img src="data:," style="display:none" onerror="{script}">'
